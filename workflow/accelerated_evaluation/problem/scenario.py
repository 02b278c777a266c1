"""The problem of a scenario: the probability of an event, given a joint law and a vehicle."""

import os
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from fewruns.problems import Response

from accelerated_evaluation.base.arrays import Array
from accelerated_evaluation.base.digests import value_digest, without_addresses
from accelerated_evaluation.base.errors import InputError
from accelerated_evaluation.laws.joint import JointLaw
from accelerated_evaluation.laws.joint.files import read_joint_law
from accelerated_evaluation.laws.joint.folding import folded
from accelerated_evaluation.laws.joint.truncated_normals import TruncatedNormalMixture
from accelerated_evaluation.scenarios.protocol import Event, Scenario
from accelerated_evaluation.vehicles.protocol import Vehicle, repeats_itself


@dataclass(frozen=True)
class ScenarioProblem:
    """The problem to estimate the probability of an event for a vehicle, if encounters follow a joint law.

    Attributes
    ----------
    scenario
        The scenario.
    law
        The joint law f of the variables.
    vehicle
        The vehicle under test.
    event
        The event.
    graded
        Whether a sampler receives the score of each encounter in addition to whether the event happened.

    Raises
    ------
    InputError
        If the law has other variables than the scenario, or exceeds the limits of the scenario.
    """

    scenario: Scenario
    law: JointLaw
    vehicle: Vehicle
    event: Event
    graded: bool = True

    def __post_init__(self) -> None:
        require_law(self.scenario, self.law)

    @property
    def dimension(self) -> int:
        """Number d of variables, and of normal scores."""
        return self.law.dimension

    @property
    def fingerprint(self) -> str:
        """A text that identifies the problem; the law is represented by a digest of its parameters.

        A sampler resumes a saved state only for a problem with the same text.
        """
        law = value_digest([self.law.kind, self.law.box.content(), self.law.content()])
        parts = (self.scenario.name, law, self.vehicle, self.event, self.graded)
        return without_addresses(repr(parts))

    @property
    def deterministic(self) -> bool | None:
        """Whether an encounter that is simulated again has the same outcome; None if this is unknown."""
        return False if getattr(self.vehicle, "striped", False) else repeats_itself(self.vehicle)

    def simulate(self, x: Array) -> Any:  # noqa: ANN401
        """Simulate the encounters with given variables.

        Parameters
        ----------
        x
            Values of the d variables of the law in each encounter, shape (n, d).

        Returns
        -------
        object
            The outcomes, an instance of the scenario's type of outcomes, whose arrays have shape (n,).
        """
        return self.vehicle.simulate(*self.scenario.to_inputs(x).T)

    def evaluate(self, z: Array) -> Response:
        """Simulate the encounters at normal scores z, shape (n, d).

        Return whether the event happened, shape (n,), and the scores, shape (n,), or None without scores. A
        score is smaller the closer the run came to the event.
        """
        return self.response(self.simulate(self.law.from_normal_scores(z)))

    def repeat(self, z: Array) -> Response:
        """Simulate the encounters at normal scores z, shape (n, d), again, even if their outcomes are stored.

        Return whether the event happened, shape (n,), and the scores, shape (n,), or None without scores.
        """
        again = getattr(self.vehicle, "repeat", self.vehicle.simulate)
        return self.response(again(*self.scenario.to_inputs(self.law.from_normal_scores(z)).T))

    def coordinates(self, z: Array) -> dict[str, Array]:
        """Return the variables at normal scores z, shape (n, d), by name, each of shape (n,)."""
        return dict(zip(self.scenario.names, self.law.from_normal_scores(z).T, strict=True))

    def response(self, outcomes: Any) -> Response:  # noqa: ANN401
        """Return whether the event happened in n simulated outcomes, and their scores, each of shape (n,).

        The scores are None if ``graded`` is false.
        """
        return self.event.happens(outcomes), self.event.score(outcomes) if self.graded else None


def require_law(scenario: Scenario, law: JointLaw) -> None:
    """Raise InputError if a law has other variables than a scenario, or exceeds the scenario's limits."""
    own = np.column_stack([law.box.lower, law.box.upper])
    if law.box.names != scenario.names or not _within(own, scenario.limits):
        raise InputError(
            f"the law for the scenario {scenario.name}",
            seen=_in_words(law.box.names, own),
            expected=f"limits within {_in_words(scenario.names, scenario.limits)}",
            change="Name a law of this scenario, or fit the law again within these limits.",
        )


def read_scenario_law(scenario: Scenario, path: str | os.PathLike) -> JointLaw:
    """Return the joint law for a scenario that a file describes.

    A law that allows negative values of a variable whose sign does not matter is folded: the variable is
    replaced by its absolute value.

    Raises
    ------
    InputError
        If the file is not a joint law, or the law has other variables or exceeds the scenario's limits.
    """
    law = read_joint_law(path)
    require_law(scenario, law)
    for k, variable in enumerate(scenario.variables):
        if not variable.sign_matters and isinstance(law, TruncatedNormalMixture) and law.box.lower[k] < 0:
            law = folded(law, k)
    return law


def _within(limits: Array, others: Array) -> bool:
    """Return whether limits, shape (d, 2), are within others."""
    return bool((limits[:, 0] >= others[:, 0]).all() and (limits[:, 1] <= others[:, 1]).all())


def _in_words(names: Sequence[str], limits: Array) -> str:
    """Return the limits of variables, shape (d, 2), as text."""
    rows = zip(names, limits.tolist(), strict=True)
    return ", ".join(f"{name} from {low:g} to {high:g}" for name, (low, high) in rows)
