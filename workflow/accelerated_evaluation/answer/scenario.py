"""The study of a scenario: its records, the laws that they support, and the answer."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Self

import numpy as np
import pandas as pd
from fewruns.problems import Response
from numpy.typing import NDArray

from accelerated_evaluation.answer.evidence import known_runs
from accelerated_evaluation.answer.extrapolation import extrapolation_table, parts_by_distance, reweighted
from accelerated_evaluation.answer.joint.posterior import (
    FEW,
    DrawnLaws,
    answer_tables,
    posterior_of_events,
    simulated_events,
    surrogate_posterior,
)
from accelerated_evaluation.answer.joint.scores import CANDIDATES, ClusteredRecords, ScoredLaws, score_laws
from accelerated_evaluation.answer.replays import Replays
from accelerated_evaluation.answer.reweighting import SampledPosterior
from accelerated_evaluation.base.arrays import Array
from accelerated_evaluation.base.errors import InputError
from accelerated_evaluation.base.randomness import child_generator
from accelerated_evaluation.laws.joint import Box, JointLaw
from accelerated_evaluation.scenarios.protocol import CLUSTER, FITTED, Event, Scenario
from accelerated_evaluation.vehicles.protocol import Vehicle, repeats_itself

WHOLE = "all encounters"  # name of the law without a restriction
FEWEST = 50  # smallest number of records, so that the region near the event, with a tenth of them, has a few
TIED = 1e-9  # relative size of the residuals of a variable that is a linear function of others
POINTS = 20_000  # number of draws with which the probability of a part of the encounters is estimated


def clustered_records(scenario: Scenario, records: pd.DataFrame) -> ClusteredRecords:
    """Return the records to which laws are fitted, with their clusters and the limits of the variables.

    Parameters
    ----------
    scenario
        The scenario.
    records
        Its record table, whose column `FITTED` marks the records for the fit.

    Raises
    ------
    InputError
        If there are fewer than `FEWEST` records, or if a variable is constant or a linear function of others.
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
    """A joint law conditional on a part of its encounters.

    Attributes
    ----------
    law
        The unconditional law.
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
        """Condition a law on a part of its encounters.

        The probability of the part is estimated by its share of `POINTS` draws.

        Parameters
        ----------
        law
            The law.
        holds
            Function that returns whether points, shape (n, d), are in the part.
        generator
            Source of the draws.

        Returns
        -------
        Restricted
            The conditional law.
        """
        return cls(law, holds, float(holds(law.sample(POINTS, generator)).mean()))

    @property
    def box(self) -> Box:
        """The variables and their limits."""
        return self.law.box

    def log_density(self, x: Array) -> Array:
        """Return the log density at points x, shape (n, d); it is -inf outside of the part. Shape (n,)."""
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
        Draws of the law and of its parameters from their posterior.
    table
        Table of the laws with their scores and weights; see `ScoredLaws.table`.
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
        """Fit and score the laws of a scenario, and draw from their posterior.

        Parameters
        ----------
        scenario, records
            The scenario and its records.
        vehicle
            A vehicle that is fast to simulate. Its scores determine which records are near the event.
        seed
            Root seed of the study.
        draws
            Number of draws of the law.

        Returns
        -------
        ScenarioStudy
            The fitted laws with their scores, and the draws of the law.
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
        """Return the draws of the law, conditional on a part of the encounters.

        Parameters
        ----------
        name
            A name in `Scenario.restrictions`, or `WHOLE` for all encounters.
        generator
            Source of randomness.
        """
        if name == WHOLE:
            return self.drawn
        holds = self.scenario.restrictions[name]
        laws = [Restricted.of(law, holds, generator) for law in self.drawn.laws]
        return DrawnLaws(laws, self.drawn.member, self.drawn.names)

    def answers(self, vehicle: Vehicle, seed: int, simulations: int) -> dict[str, pd.DataFrame]:
        """Estimate the probability of every event in every part of the encounters, by crude Monte Carlo.

        Parameters
        ----------
        vehicle
            A vehicle that is fast to simulate.
        seed
            Root seed of the study.
        simulations
            Number of simulations for each event and part; more are made for rare events.

        Returns
        -------
        dict
            ``answer``, a row for each ``event`` and part (``encounters``) with the mean ``probability``, the
            ``median``, and the ends ``low50`` to ``high95`` of the 50, 80 and 95 % credible intervals; and,
            for a crash in all encounters, ``budget`` (variance of the log probability by source),
            ``draws`` (the probability under each draw of the law) and ``extrapolation`` (the parts of the
            probability by distance from the records, see `extrapolation.extrapolation_table`).
        """
        rows, tables = [], {}
        for restriction in (WHOLE, *self.scenario.restrictions):
            generator = child_generator(seed, "scenario", "answer", restriction)
            drawn = self.restricted(restriction, generator)
            for event in self.scenario.events:
                named, respond = self.scenario.event_in_words(event), responder(self.scenario, vehicle, event)
                events, size = simulated_events(drawn, respond, generator, simulations)
                posterior = posterior_of_events(drawn, events, size)
                made = answer_tables(posterior, drawn)
                rows.append(made["answer"].assign(event=named, encounters=restriction))
                if not tables:
                    tables = made | {"extrapolation": self._extrapolation(events, posterior, vehicle)}
        return tables | {"answer": pd.concat(rows, ignore_index=True)}

    def _extrapolation(self, events: Array, posterior: SampledPosterior, vehicle: Vehicle) -> pd.DataFrame:
        """Divide the probability of the first event by the distance of simulated events from the records."""
        records = self.scored.records.x
        happened, _ = responder(self.scenario, vehicle, self.scenario.events[0])(records)
        weights = reweighted(self.drawn.log_ratios(events), 1.0, posterior.probabilities)
        parts, replayed = (parts_by_distance(records, x) for x in (events, records[happened]))
        return extrapolation_table(parts, weights, len(records), replayed)

    def answer_by_few_runs(
        self, vehicle: Vehicle, seed: int, event: Event, replays: Replays, simulations: int = FEW
    ) -> dict[str, pd.DataFrame]:
        """Estimate the probability of an event for a slow vehicle from few simulations.

        The surrogate-guided sampler chooses the simulations.

        Parameters
        ----------
        vehicle
            The vehicle.
        seed
            Root seed of the study.
        event
            The event.
        replays
            The vehicle's replays of the records, which guide the sampler if some ended with the event.
        simulations
            Largest number of simulations.

        Returns
        -------
        dict
            ``answer``, with the probability and its intervals; ``budget``, the variance of the log
            probability by source; and ``draws``, the probability under each draw of the law. The answer has
            the further columns ``simulations`` and ``converged``, and, if the vehicle may lapse (rarely
            behave differently than in most runs of the same encounter), upper ends that contain the bound in
            the column ``unseen_lapses``.

        Raises
        ------
        InputError
            If the event did not happen often enough for an estimate.
        """
        generator = child_generator(seed, "scenario", "few runs")
        posterior, sampler, converged = surrogate_posterior(
            self.drawn,
            responder(self.scenario, vehicle, event),
            generator,
            simulations,
            filled=event.filled,
            deterministic=repeats_itself(vehicle),
            repeat=responder(self.scenario, vehicle, event, again=True),
            known=partial(known_runs, replays),
        )
        if posterior is None:
            raise InputError(
                f"the laws of the scenario {self.scenario.name}",
                seen=f"no {self.scenario.event_in_words(event)} in {sampler.simulations} runs",
                expected="laws with probability where the event happens",
                change="Check the vehicle and the limits of the variables.",
            )
        tables = answer_tables(posterior, self.drawn)
        own = {
            "event": self.scenario.event_in_words(event),
            "simulations": sampler.simulations,
            "converged": converged,
            "unseen_lapses": posterior.unseen_lapses,
        }
        return tables | {"answer": tables["answer"].assign(encounters=WHOLE, **own)}


def responder(
    scenario: Scenario, vehicle: Vehicle, event: Event, *, again: bool = False
) -> Callable[[Array], Response]:
    """Return a function that simulates a vehicle at points of a law, and returns events and scores.

    The function takes points of shape (n, d). It returns whether the event happened and the score of the
    event, both of shape (n,), as `ScoreProblem.evaluate` does.

    Parameters
    ----------
    scenario, vehicle, event
        The scenario, the vehicle and the event.
    again
        Whether encounters are simulated again although their outcomes are stored.
    """
    simulate = getattr(vehicle, "repeat", vehicle.simulate) if again else vehicle.simulate

    def respond(x: Array) -> Response:
        outcomes = simulate(*scenario.to_inputs(x).T)
        return event.happens(outcomes), event.score(outcomes)

    return respond


def records_account(scenario: Scenario, records: pd.DataFrame) -> pd.DataFrame:
    """Describe the records of a scenario: number of rows and clusters, and quantiles of each variable.

    Parameters
    ----------
    scenario
        The scenario.
    records
        Its record table.

    Returns
    -------
    pandas.DataFrame
        One row for each variable: ``variable``; ``unit``; the numbers of ``records``, of records for the fit
        (``fitted``), of ``clusters``, of ``repeated`` records (all variables are equal to those of an earlier
        record) and of records ``outside`` of the limits; ``smallest``, ``median`` and ``largest`` value.
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
