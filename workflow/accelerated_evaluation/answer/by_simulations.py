"""The answer from crude Monte Carlo under the mean of all draws, reweighted for each draw."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd

from accelerated_evaluation.answer.answer import Answer, Crashes
from accelerated_evaluation.answer.by_scan import exact_probability
from accelerated_evaluation.answer.posterior import SampledPosterior
from accelerated_evaluation.base.arguments import a_number, checked
from accelerated_evaluation.base.errors import InputError
from accelerated_evaluation.base.randomness import child_generator
from accelerated_evaluation.laws import Law
from accelerated_evaluation.laws.draws import Draws
from accelerated_evaluation.methods import METHODS
from accelerated_evaluation.methods.problem import Problem
from accelerated_evaluation.methods.study import study_method
from accelerated_evaluation.scenarios.protocol import ENDED, Event, Scenario
from accelerated_evaluation.vehicles.protocol import Vehicle, event_named

ENOUGH_EVENTS = 100  # simulations are repeated with other encounters until there are so many events,
ROUNDS = 25  # or so many repetitions
SMALLEST = 1e-3  # lower bound of the estimate of a draw, as a share of the mean


@checked(size=a_number(1, whole=True))
@dataclass(frozen=True)
class Simulations:
    """The way to an answer by many simulations, for fast vehicles in any scenario.

    Parameters
    ----------
    size
        Number of simulations, which is repeated up to 25 times until the event has happened 100 times.

    Examples
    --------
    >>> import accelerated_evaluation as ae
    >>> draws = ae.choose_draws("independent_variables", ae.read_records("left_turn"))
    >>> problem = ae.Problem("left_turn", "acc_aeb")
    >>> ae.evaluate(problem, draws, ae.Simulations(20_000), generator=1).simulations
    20000
    """

    size: int = 200_000

    def answer(
        self, problem: Problem, draws: Draws, events: Sequence[Event], generator: np.random.Generator
    ) -> Answer:
        """Return the probability of the events of a problem under each draw of the law.

        Raises
        ------
        InputError
            If the main event does not happen in any simulation.
        """
        every = (problem.event, *(event for event in events if event != problem.event))
        found: dict[Event, list] = {event: [] for event in every}
        size, rounds = 0, 0
        while rounds < ROUNDS and sum(len(part[0]) for part in found[problem.event]) < ENOUGH_EVENTS:
            x = draws.draw_from_mean(self.size, generator)
            outcomes = problem.simulate(x)
            impact = getattr(outcomes, "impact_speed", np.full(len(x), np.nan))
            for event, parts in found.items():
                happened = event.happens(outcomes)
                parts.append((x[happened], impact[happened]))
            size, rounds = size + len(x), rounds + 1
        if not sum(len(part[0]) for part in found[problem.event]):
            raise InputError(
                f"the laws {', '.join(sorted(set(draws.names)))}",
                seen=f"no {problem.event.quantity} in {size:,} encounters drawn from them, so that its "
                f"probability is 0 or below {3 / size:.1g} (95 % confidence)",
                expected="laws with probability where the event happens",
                change="Check the limits of the variables and the event. If the event is really so rare, "
                "state that the vehicle is slow (simulations.slow), which selects the simulations.",
            )
        crashes = {event: _crashes(parts, draws, size) for event, parts in found.items()}
        posteriors = {event: _posterior(own, draws, size) for event, own in crashes.items()}
        return Answer(problem, draws, posteriors, crashes[problem.event], simulations=size, independent=size)


def _crashes(parts: list, draws: Draws, size: int) -> Crashes:
    """Return the occurrences of an event among ``size`` simulations, with their weights under each draw."""
    x, impact = (np.concatenate(column) for column in zip(*parts, strict=True))
    return Crashes(x, impact[:, None], np.exp(draws.log_ratios_to_mean(x)) / size)


def _posterior(crashes: Crashes, draws: Draws, size: int) -> SampledPosterior | None:
    """Return the posterior of the probability of an event from its n weighted occurrences among ``size``."""
    estimates = crashes.weights.sum(axis=1)
    if not estimates.any():
        return None
    squares = size * (crashes.weights**2).sum(axis=1)
    variances = np.maximum(squares - estimates**2, 0) / size
    known = np.maximum(estimates, SMALLEST * estimates.mean())
    return SampledPosterior(known, draws.member, np.minimum(np.sqrt(variances) / known, 1), size)


METHODS_OF_SCORES = ("crude", "normal_mixture", "surrogate")  # methods that only need normal scores


def compare_methods(
    scenario: Scenario,
    laws: Mapping[str, Law],
    vehicle: Vehicle,
    config: Mapping[str, Any],
) -> dict[str, pd.DataFrame]:
    """Estimate the probability of an event under single laws by several methods.

    The result has ``estimates``, with a row for each law, method and replicate, and ``runs``, with a row for
    each simulation of the surrogate-guided method. The columns ``exact`` and ``exact_error`` of the estimates
    have the probability from a scan and its relative standard error, NaN if the scenario has no scans.
    """
    event = event_named(config["scenario"]["event"], scenario)
    parts: dict[str, list[pd.DataFrame]] = {"estimates": [], "runs": []}
    for law_name, law in laws.items():
        problem = Problem(scenario, vehicle, event, law=law)
        known = exact_probability(problem, child_generator(config["seed"], "scenario", "exact", law_name))
        for name in METHODS_OF_SCORES:
            method = METHODS[name].configured(config)
            count = method.replicates(config) or 1
            stream = config["seed"], "scenario", name, law_name
            generators = [child_generator(*stream, replicate) for replicate in range(count)]
            labels = {"study": config["study"], "law": law_name, "method": name}
            made = study_method(method, problem, method.stopping(config), generators, labels)
            made["estimates"] = made["estimates"].assign(exact=known[0], exact_error=known[1])
            for table, rows in made.items():
                parts[table].append(rows)
    made = {name: pd.concat(rows, ignore_index=True) for name, rows in parts.items() if rows}
    return made | {"estimates": made["estimates"].assign(event=scenario.event_in_words(event))}


def read_verdicts(scenario: Scenario, paths: Sequence[str]) -> pd.DataFrame:
    """Read tables of published verdicts as one table, which is empty without a path.

    It has the variables of the scenario, ``crash`` (0 or 1), and ``fragile`` (1 if rounding decides about the
    crash).
    """
    columns = [*scenario.names, "crash", "fragile"]
    parts = [pd.read_csv(path, usecols=columns) for path in paths]
    return pd.concat(parts, ignore_index=True) if parts else pd.DataFrame(columns=columns, dtype=float)


def agreement(scenario: Scenario, vehicle: Vehicle, verdicts: pd.DataFrame) -> pd.DataFrame:
    """Compare the outcomes of a vehicle with published verdicts on the same encounters.

    There is one row for the firm and one for the fragile verdicts, with their number, and the numbers of
    those that ``agree``; of those in which only our vehicle crashes (``we_crash``) or only the published one
    (``we_are_safe``); and of our simulations that ended at their time limit (``not_ended``).
    """
    outcomes = vehicle.simulate(*(verdicts[name].to_numpy(float) for name in scenario.names))
    ended = getattr(outcomes, ENDED, np.ones(len(verdicts), bool))
    published, fragile = verdicts["crash"].to_numpy() > 0, verdicts["fragile"].to_numpy() > 0
    rows = []
    for name, own in (("firm", ~fragile), ("fragile", fragile)):
        ours, theirs = outcomes.crash[own], published[own]
        rows.append(
            {
                "kind": name,
                "verdicts": int(own.sum()),
                "agree": int((ours == theirs).sum()),
                "we_crash": int((ours & ~theirs).sum()),
                "we_are_safe": int((~ours & theirs).sum()),
                "not_ended": int((~ended[own]).sum()),
            }
        )
    return pd.DataFrame(rows)
