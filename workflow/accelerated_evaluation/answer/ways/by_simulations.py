"""The answer from crude Monte Carlo under the mean of all draws, reweighted for each draw."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from accelerated_evaluation.answer.ways.answer import Answer, Crashes
from accelerated_evaluation.answer.ways.posterior import count_limits, counted_posterior
from accelerated_evaluation.base.arguments import a_number
from accelerated_evaluation.base.checking import checked
from accelerated_evaluation.base.errors import InputError
from accelerated_evaluation.laws.draws import Draws
from accelerated_evaluation.methods.problem import Problem
from accelerated_evaluation.scenarios.events import Event

ENOUGH_EVENTS = 100  # simulations are repeated with other encounters until there are so many events,
ROUNDS = 25  # or so many repetitions


@checked(size=a_number(1, 10**8, whole=True))
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

        InputError is raised if the main event does not happen in any simulation.
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
        posteriors = {
            event: counted_posterior(own.weights, size, draws.member) for event, own in crashes.items()
        }
        limits = {event: count_limits(len(own.x), size) for event, own in crashes.items()}
        return Answer(problem, draws, posteriors, crashes[problem.event], simulations=size, limits=limits)


def _crashes(parts: list, draws: Draws, size: int) -> Crashes:
    """Return the occurrences of an event among ``size`` simulations, with their weights under each draw."""
    x, impact = (np.concatenate(column) for column in zip(*parts, strict=True))
    return Crashes(x, impact[:, None], np.exp(draws.log_ratios_to_mean(x)) / size)
