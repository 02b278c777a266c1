"""The study of a scenario: its records, the laws that they support, and the answer."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Self

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from accelerated_evaluation.answer.joint.posterior import (
    FEW,
    DrawnLaws,
    answer_tables,
    simulated_posterior,
    surrogate_posterior,
)
from accelerated_evaluation.answer.joint.scores import CANDIDATES, ClusteredRecords, ScoredLaws, score_laws
from accelerated_evaluation.base.arrays import Array
from accelerated_evaluation.base.errors import InputError
from accelerated_evaluation.base.randomness import child_generator
from accelerated_evaluation.laws.joint import Box, JointLaw
from accelerated_evaluation.problem import Response
from accelerated_evaluation.scenarios.protocol import CLUSTER, FITTED, Event, Scenario
from accelerated_evaluation.vehicles.protocol import Vehicle

WHOLE = "all encounters"  # name of the law without a restriction
FEWEST = 50  # records, so that the region near the event, a tenth of them, has a few
TIED = 1e-9  # relative size of what is left of a variable that follows from others
POINTS = 20_000  # with which the share of a restricted law is found


def clustered_records(scenario: Scenario, records: pd.DataFrame) -> ClusteredRecords:
    """Return the records to which laws are fitted, within the limits of the scenario.

    Raises
    ------
    InputError
        If a joint law cannot be fitted to them, because they are too few or their variables are tied.
    """
    fitted = records[records[FITTED]]
    if len(fitted) < FEWEST:
        raise InputError(
            f"the records of the scenario {scenario.name}",
            seen=f"{len(fitted)} of {len(records)} within the limits of the variables and not repeated",
            expected=f"{FEWEST} or more, to which laws can be fitted",
            change="Check the units of the columns with the command inspect, or name more records.",
        )
    box = Box(scenario.names, *(tuple(map(float, side)) for side in scenario.law_limits.T))
    x = scenario.as_in_law(fitted[list(scenario.names)].to_numpy(float))
    for k, name in enumerate(scenario.names):
        _require_variation(x[:, : k + 1], f"the records of the scenario {scenario.name}, column {name}")
    return ClusteredRecords.of(x, fitted[CLUSTER], box)


def _require_variation(x: Array, where: str) -> None:
    """Raise InputError if the last variable is constant or follows linearly from the others."""
    others, last = np.column_stack([np.ones(len(x)), x[:, :-1]]), x[:, -1]
    rest = last - others @ np.linalg.lstsq(others, last, rcond=None)[0]
    if np.abs(rest).max() <= TIED * np.abs(last).max():
        raise InputError(
            where,
            seen="one value in all records" if np.ptp(last) == 0 else "a linear function of earlier columns",
            expected="values that vary, to which a joint distribution can be fitted",
            change="Check how the column was made.",
        )


@dataclass(frozen=True)
class Restricted:
    """A joint law, given that the encounter is in a part of its box.

    Attributes
    ----------
    law
        The law.
    holds
        Function that returns whether points, shape (n, d), are in the part.
    share
        Probability of the part under the law.
    """

    law: JointLaw
    holds: Callable[[Array], NDArray[np.bool_]]
    share: float

    @classmethod
    def of(
        cls, law: JointLaw, holds: Callable[[Array], NDArray[np.bool_]], generator: np.random.Generator
    ) -> Self:
        """Restrict a law; its share is that among `POINTS` draws."""
        return cls(law, holds, float(holds(law.sample(POINTS, generator)).mean()))

    @property
    def box(self) -> Box:
        """The variables and their limits."""
        return self.law.box

    def log_density(self, x: Array) -> Array:
        """Return the log density at points, shape (n, d); it is -inf outside the part."""
        return np.where(self.holds(x), self.law.log_density(x) - np.log(self.share), -np.inf)

    def sample(self, n: int, generator: np.random.Generator) -> Array:
        """Draw n points, shape (n, d), by rejection."""
        kept = np.empty((0, self.law.dimension))
        while len(kept) < n:
            x = self.law.sample(n, generator)
            kept = np.concatenate([kept, x[self.holds(x)]])
        return kept[:n]


@dataclass(frozen=True)
class ScenarioStudy:
    """Laws fitted to the records of a scenario, and draws from their posterior.

    Attributes
    ----------
    scenario
        The scenario.
    scored
        The laws with their scores on held-out clusters.
    drawn
        Draws of the law and its parameters.
    table
        The laws as a table; see `ScoredLaws.table`.
    """

    scenario: Scenario
    scored: ScoredLaws
    drawn: DrawnLaws
    table: pd.DataFrame

    @classmethod
    def of(
        cls,
        scenario: Scenario,
        records: pd.DataFrame,
        vehicle: Vehicle,
        seed: int,
        draws: int,
    ) -> Self:
        """Fit and score the laws, and draw from their posterior.

        Parameters
        ----------
        scenario, records
            The scenario and its records.
        vehicle
            A fast vehicle, whose scores say which records are near the event.
        seed
            Root seed.
        draws
            Number of draws.
        """
        clustered = clustered_records(scenario, records)
        generator = child_generator(seed, "scenario", "laws")
        respond = responder(scenario, vehicle, scenario.events[0])
        scored = score_laws(clustered, respond, generator, CANDIDATES)
        table = scored.table(scored.weights(draws, generator))
        return cls(scenario, scored, DrawnLaws.of(scored, generator, draws), table)

    @property
    def heaviest(self) -> JointLaw:
        """The fitted law with the largest weight."""
        return self.scored.laws[int(self.table["weight"].to_numpy().argmax())]

    def restricted(self, name: str, generator: np.random.Generator) -> DrawnLaws:
        """Return the draws restricted to a part of the encounters that the scenario names."""
        if name == WHOLE:
            return self.drawn
        holds = self.scenario.restrictions[name]
        laws = [Restricted.of(law, holds, generator) for law in self.drawn.laws]
        return DrawnLaws(laws, self.drawn.member, self.drawn.names)

    def answers(self, vehicle: Vehicle, seed: int, simulations: int) -> dict[str, pd.DataFrame]:
        """Return the answer by crude Monte Carlo under all draws, for every event and restriction.

        Returns
        -------
        dict
            ``answer``, a row for each event and restriction, which is in the column ``encounters``;
            ``budget`` and ``draws`` of the crash over all encounters.
        """
        rows, tables = [], {}
        for restriction in (WHOLE, *self.scenario.restrictions):
            generator = child_generator(seed, "scenario", "answer", restriction)
            drawn = self.restricted(restriction, generator)
            for event in self.scenario.events:
                named, respond = self.scenario.event_in_words(event), responder(self.scenario, vehicle, event)
                made = answer_tables(simulated_posterior(drawn, respond, generator, simulations), drawn)
                rows.append(made["answer"].assign(event=named, encounters=restriction))
                tables = tables or made
        return tables | {"answer": pd.concat(rows, ignore_index=True)}

    def answer_by_few_runs(
        self, vehicle: Vehicle, seed: int, simulations: int = FEW
    ) -> dict[str, pd.DataFrame]:
        """Return the answer for the crash by few runs of an expensive vehicle; see `surrogate_posterior`.

        Raises
        ------
        InputError
            If none of the runs ends in a crash.
        """
        generator = child_generator(seed, "scenario", "few runs")
        respond = responder(self.scenario, vehicle, self.scenario.events[0])
        posterior, sampler, converged = surrogate_posterior(self.drawn, respond, generator, simulations)
        if posterior is None:
            raise InputError(
                f"the laws of the scenario {self.scenario.name}",
                seen=f"no crash in {sampler.simulations} runs",
                expected="laws with probability where the event happens",
                change="Check the vehicle and the limits of the variables.",
            )
        tables = answer_tables(posterior, self.drawn)
        own = {"simulations": sampler.simulations, "converged": converged}
        return tables | {"answer": tables["answer"].assign(encounters=WHOLE, **own)}


def responder(scenario: Scenario, vehicle: Vehicle, event: Event) -> Callable[[Array], Response]:
    """Return a function that runs a vehicle at points of a law, shape (n, d); see `ScoreProblem.evaluate`."""

    def respond(x: Array) -> Response:
        outcomes = vehicle.simulate(*scenario.to_inputs(x).T)
        return event.happens(outcomes), event.score(outcomes)

    return respond


def records_account(scenario: Scenario, records: pd.DataFrame) -> pd.DataFrame:
    """Describe the records: rows, clusters, and the range of each variable.

    Returns
    -------
    pandas.DataFrame
        A row for each variable: ``variable``, ``unit``, ``records``, ``fitted``, ``clusters``, ``repeated``
        (rows whose variables repeat those of an earlier row), ``outside`` (rows beyond the limits),
        ``smallest``, ``median`` and ``largest``.
    """
    repeated = int(records.duplicated(list(scenario.names)).sum())
    rows = []
    for each in scenario.variables:
        values = records[each.name]
        rows.append(
            {
                "variable": each.name,
                "unit": each.unit,
                "records": len(records),
                "fitted": int(records[FITTED].sum()),
                "clusters": records[CLUSTER].nunique(),
                "repeated": repeated,
                "outside": int((~values.between(each.low, each.high)).sum()),
                "smallest": values.min(),
                "median": values.median(),
                "largest": values.max(),
            }
        )
    return pd.DataFrame(rows)
