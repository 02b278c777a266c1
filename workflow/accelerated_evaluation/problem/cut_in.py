"""The problem of cut-ins: the probability of an event, given a law of cut-ins and a vehicle."""

import os
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, fields, replace
from typing import Any, Self

import numpy as np
from fewruns.problems import Response
from numpy.typing import NDArray

from accelerated_evaluation.base.arrays import Array
from accelerated_evaluation.base.digests import without_addresses
from accelerated_evaluation.laws import CutIns, Factors, Law
from accelerated_evaluation.laws.files import read_law
from accelerated_evaluation.records.encounter_table import read_encounters
from accelerated_evaluation.scenarios.protocol import Event
from accelerated_evaluation.vehicles.events import CRASH
from accelerated_evaluation.vehicles.external.slow import loaded_for
from accelerated_evaluation.vehicles.protocol import Outcomes, Vehicle, repeats_itself


@dataclass(frozen=True)
class Sample:
    """Simulated cut-ins of one stratum, drawn from a proposal f*; every array has shape (n,).

    Attributes
    ----------
    first, second
        The two coordinates of the cut-ins in the stratum; for the paper's laws R^-1 [1/m] and TTC^-1 [1/s].
    log_ratio
        Log importance weight log(f / f*).
    happened
        Whether the event happened.
    outcomes
        Outcomes of the simulations.
    """

    first: Array
    second: Array
    log_ratio: Array
    happened: NDArray[np.bool_]
    outcomes: Outcomes

    def join(self, other: "Sample") -> "Sample":
        """Return a sample with the cut-ins of this sample, followed by those of another sample."""

        def joined(one: Outcomes | Sample, two: Outcomes | Sample, skip: str = "") -> dict[str, Array]:
            names = [field.name for field in fields(one) if field.name != skip]
            return {name: np.concatenate([getattr(one, name), getattr(two, name)]) for name in names}

        outcomes = Outcomes(**joined(self.outcomes, other.outcomes))
        return Sample(**joined(self, other, skip="outcomes"), outcomes=outcomes)

    @property
    def weight(self) -> Array:
        """I(x) f(x) / f*(x) of each cut-in x, shape (n,), where I(x) is 1 if the event happened, otherwise 0.

        The mean estimates the probability of the event (paper, section IV.A).
        """
        return np.where(self.happened, np.exp(self.log_ratio), 0.0)


@dataclass(frozen=True)
class Problem:
    """The problem to estimate the probability of an event for a vehicle, if cut-ins follow a law.

    Attributes
    ----------
    law
        The law f of the cut-ins.
    vehicle
        The car under test.
    event
        The event, a crash by default.
    graded
        Whether a sampler receives the score of each encounter in addition to whether the event happened.
    """

    law: Law
    vehicle: Vehicle
    event: Event = CRASH
    graded: bool = True

    dimension = 3

    @property
    def fingerprint(self) -> str:
        """A text that identifies law, vehicle, event and ``graded``.

        A sampler resumes a saved state only for a problem with the same text.

        An object without a ``repr`` of its own is represented by the name of its class.
        """
        return without_addresses(repr(self))

    @property
    def deterministic(self) -> bool | None:
        """Whether a cut-in that is simulated again has the same outcome; None if this is unknown.

        It is false for a vehicle with the attribute ``striped``, whose outcomes change between encounters
        that are almost equal.
        """
        return False if getattr(self.vehicle, "striped", False) else repeats_itself(self.vehicle)

    @property
    def upper_set(self) -> bool:
        """Whether the event also happens in a cut-in that closes in faster, so that no part of it is hidden.

        This is assumed of all vehicles except those with the attribute ``striped``.
        """
        return not getattr(self.vehicle, "striped", False)

    def only(self, stratum: str) -> Self:
        """Return the problem restricted to one stratum (interval of the lead speed), given its name."""
        return replace(self, law=self.law.only(stratum))

    def simulate(self, cut_ins: CutIns) -> Outcomes:
        """Simulate n cut-ins, with closing speeds capped by the law; return the outcomes, shape (n,)."""
        return self.vehicle.simulate(
            cut_ins.lead_speed, cut_ins.range_, self.law.capped(cut_ins.closing_speed)
        )

    def evaluate(self, z: Array) -> Response:
        """Simulate the cut-ins at normal scores z, shape (n, 3).

        Return whether the event happened, shape (n,), and the scores, shape (n,), or None without scores. A
        score is smaller the closer the run came to the event.
        """
        return self._response(self.simulate(self.law.from_normal_scores(z)))

    def repeat(self, z: Array) -> Response:
        """Simulate the cut-ins at normal scores z, shape (n, 3), again, even if their outcomes are stored.

        Return whether the event happened, shape (n,), and the scores, shape (n,), or None without scores.
        """
        cut_ins = self.law.from_normal_scores(z)
        again = getattr(self.vehicle, "repeat", self.vehicle.simulate)
        closing_speed = self.law.capped(cut_ins.closing_speed)
        return self._response(again(cut_ins.lead_speed, cut_ins.range_, closing_speed))

    def coordinates(self, z: Array) -> dict[str, Array]:
        """Return the cut-ins at normal scores z, shape (n, 3), as a dictionary of arrays of shape (n,).

        The names are ``lead_speed`` [m/s], ``inverse_range`` [1/m] and ``inverse_ttc`` [1/s].
        """
        return vars(self.law.from_normal_scores(z))

    def _response(self, outcomes: Outcomes) -> Response:
        return self.event.happens(outcomes), self.event.score(outcomes) if self.graded else None

    def sample(self, stratum: str, proposal: Factors, generator: np.random.Generator, size: int) -> Sample:
        """Draw cut-ins of one stratum from a proposal f*, simulate them, and weight them by f / f*.

        Parameters
        ----------
        stratum
            Name of the stratum.
        proposal
            f* in the coordinates of the stratum; the lead speed is drawn from the law.
        generator
            Random generator.
        size
            Number of cut-ins.
        """
        f = self.law.strata[stratum]
        lead_speed = f.lead_speed.rvs(generator, size)
        coordinates = proposal.rvs(generator, size)
        # Both densities are of the coordinates, so the Jacobian of the map to cut-ins cancels.
        log_ratio = f.factors.logpdf(*coordinates) - proposal.logpdf(*coordinates)
        outcomes = self.simulate(f.cut_ins(lead_speed, *coordinates))
        return Sample(*coordinates, log_ratio, self.event.happens(outcomes), outcomes)


@contextmanager
def loaded_problem(
    law: str | os.PathLike,
    encounters: str | os.PathLike,
    vehicle: Mapping[str, Any],
    simulations: Mapping[str, Any],
) -> Iterator[Problem]:
    """Yield the problem of a crash for a law and a vehicle; the outcomes of a slow vehicle are stored.

    The vehicle is closed at the end of the ``with`` block.

    Parameters
    ----------
    law, encounters
        Paths of a law file, and of the encounter table to which the law was fitted.
    vehicle, simulations
        The sections ``vehicle`` and ``simulations`` of the configuration.
    """
    with loaded_for(vehicle, simulations) as car:
        yield Problem(read_law(law, read_encounters(encounters)), car)
