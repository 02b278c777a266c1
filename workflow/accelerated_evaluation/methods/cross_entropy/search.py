"""The Cross-Entropy search for f* (section V, appendix C).

The crash is too rare to be observed in the first samples. The search therefore begins with relaxed events,
such as a short time to collision, and makes them stricter until the event is the crash itself.
"""

import math
import os
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import Self

import numpy as np

from accelerated_evaluation.base.errors import readable
from accelerated_evaluation.base.files import read_json, write_json
from accelerated_evaluation.laws import Factors
from accelerated_evaluation.laws.distributions import from_dict
from accelerated_evaluation.methods.cross_entropy.families import ProposalFamily
from accelerated_evaluation.methods.cross_entropy.levels import Families, SearchSettings, Shift, draw_level
from accelerated_evaluation.methods.problem import Problem

COORDINATES = ("inverse_range", "inverse_ttc")  # names of the two coordinates in the trace


@dataclass(frozen=True)
class Search:
    """The state of a search in one stratum."""

    first: ProposalFamily  # family of 1 / range with its current parameters
    second: ProposalFamily  # family of 1 / TTC
    trace: list[dict[str, float]] = field(default_factory=list)  # a row for each iteration
    # Why the search ended before the crash itself was used for the updates; otherwise empty.
    unfinished: str = ""

    @property
    def proposal(self) -> Factors:
        """The accelerated distribution f*."""
        return Factors(self.first.distribution, self.second.distribution)

    @property
    def simulations(self) -> int:
        """Number of simulations so far."""
        return int(self.trace[-1]["simulations_total"]) if self.trace else 0

    def advance(self, first: ProposalFamily, second: ProposalFamily, row: dict[str, float]) -> "Search":
        """Return the next state; ``row`` and the parameters of both families are added to the trace."""
        parameters = {
            f"{coordinate}_{name}": value
            for coordinate, family in zip(COORDINATES, (first, second), strict=True)
            for name, value in family.parameters().items()
        }
        row = {"iteration": len(self.trace) + 1, **row, **parameters}
        return Search(first, second, [*self.trace, row])


def search(
    problem: Problem,
    stratum: str,
    start: Families,
    settings: SearchSettings,
    generator: np.random.Generator,
    *,
    shift: Shift = Shift(),  # noqa: B008
    on_iteration: Callable[[dict[str, float]], None] = lambda _: None,
) -> Search:
    """Search for the accelerated distribution f* of one stratum by the Cross-Entropy method.

    Every iteration simulates N cut-ins drawn from the current f*. A cut-in belongs to the relaxed event if
    its range falls to t_R or its time to collision falls to t_TTC. The thresholds are chosen such that a
    given share of the sample belongs to this event, and they never rise (`draw_level`). The new f* maximises
    the weighted likelihood of the events. A search that does not reach the crash still returns its last f*,
    with the reason. Estimates with this f* are valid, and if they contain no event they give an upper limit.
    The families are `SingleFamily` for the method single, and `PiecewiseFamily` for piecewise, heuristic and
    shifted. By default the truncation points are fixed; ``shift`` says how they move. The trace has
    thresholds, events, effective sample size, parameters and simulations of each iteration. The search is
    unfinished if the crash itself was not the event of the last ``crash_iterations`` updates, or if no
    simulation of an iteration ended in the relaxed event.
    """
    row = {"threshold_ttc_s": math.nan, "threshold_range_m": math.nan, "simulations_total": 0}
    state = Search(*start).advance(*start, row)
    on_iteration(state.trace[-1])
    threshold, at_event = math.inf, 0
    while len(state.trace) <= settings.maximum_iterations:
        level = draw_level(
            problem, stratum, (state.first, state.second), settings, shift, threshold, generator
        )
        threshold, sample, weight = level.threshold, level.sample, level.weight
        if not level.happened.any():
            reached = f"no event down to {threshold:.3g} s in {level.happened.size} simulations"
            return _unfinished(state, settings, reached)
        first, second = level.families
        updated = first.update(level.events[0], weight), second.update(level.events[1], weight)
        moved = shift.raised(updated, level.events) if shift.every_iteration else updated
        at_event = at_event + 1 if threshold == 0 and moved == updated else 0
        row = {
            "threshold_ttc_s": threshold,
            "threshold_range_m": threshold * settings.range_per_ttc,
            "simulations": level.simulations,
            "simulations_total": state.simulations + level.simulations,
            "sample": level.happened.size,
            "events": int(level.happened.sum()),
            "crashes": int(sample.happened.sum()),
            "effective_sample_size": weight.sum() ** 2 / np.square(weight).sum(),
        }
        state = state.advance(*moved, row)
        on_iteration(state.trace[-1])
        if at_event == settings.crash_iterations:
            return state
    return _unfinished(state, settings, f"events down to a time to collision of {threshold:.3g} s")


def _unfinished(state: Search, settings: SearchSettings, reached: str) -> Search:
    limit = f"{settings.maximum_iterations} iterations of {settings.sample_size} simulations"
    reason = f"the search did not come to the event: it reached {reached}, within {limit}"
    return replace(state, unfinished=reason)


@dataclass(frozen=True)
class Proposals:
    """The accelerated distribution f* of each stratum, with the number of simulations of its search."""

    factors: Mapping[str, Factors]  # f* in the coordinates of each stratum
    simulations: Mapping[str, int]  # number of simulations of each search
    # Strata whose search did not reach the event, with the reason.
    unfinished: Mapping[str, str] = field(default_factory=dict)

    @classmethod
    def of(cls, searches: Mapping[str, Search]) -> Self:
        """Return f* and the number of simulations of each stratum, given the searches by stratum."""
        factors = {stratum: search.proposal for stratum, search in searches.items()}
        simulations = {stratum: search.simulations for stratum, search in searches.items()}
        reasons = {stratum: search.unfinished for stratum, search in searches.items() if search.unfinished}
        return cls(factors, simulations, reasons)

    def only(self, stratum: str) -> Self:
        """Return the proposals restricted to one stratum, given by its name."""
        reason = {stratum: self.unfinished[stratum]} if stratum in self.unfinished else {}
        return type(self)({stratum: self.factors[stratum]}, {stratum: self.simulations[stratum]}, reason)

    @property
    def total(self) -> int:
        """Total number of simulations of all searches."""
        return sum(self.simulations.values())


def write_proposals(path: str | os.PathLike, proposals: Proposals) -> None:
    """Write f* of each stratum to a JSON file, atomically."""
    content = {
        stratum: {
            "simulations": proposals.simulations[stratum],
            "first": f.first.to_dict(),
            "second": f.second.to_dict(),
        }
        | ({"unfinished": proposals.unfinished[stratum]} if stratum in proposals.unfinished else {})
        for stratum, f in proposals.factors.items()
    }
    write_json(path, content)


def read_proposals(path: str | os.PathLike) -> Proposals:
    """Return f* of each stratum from a file of `write_proposals`; InputError is raised if it is damaged."""
    with readable(
        str(path), "a file of accelerated distributions", "Delete the file, and run the search again."
    ):
        content = read_json(path)
        factors = {
            stratum: Factors(from_dict(found["first"]), from_dict(found["second"]))
            for stratum, found in content.items()
        }
        simulations = {stratum: found["simulations"] for stratum, found in content.items()}
        reasons = {
            stratum: found["unfinished"] for stratum, found in content.items() if "unfinished" in found
        }
        return Proposals(factors, simulations, reasons)
