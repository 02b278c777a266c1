"""How often the sampler with a surrogate is right in the left turn and in the pedestrian scenario.

``python benchmarks/scenario_seeds.py left_turn LAW.json CRUDE`` repeats the estimate of the crash probability
under a joint law with 40 seeds, in at most 1,000 runs each, and compares it with CRUDE draws of the law. With
``--event impact_speed=1``, it is the probability of an impact at more than 1 m/s. The results are in
``benchmarks/results/scenarios.csv``, from which ``make pages`` makes the table of the guide.
``results/<study>/laws/answer.json`` of a study is such a law.
"""

import argparse
import math
from pathlib import Path

import numpy as np
import pandas as pd
from accelerated_evaluation.base.files import write_csv
from accelerated_evaluation.base.randomness import child_generator
from accelerated_evaluation.methods import Estimate, Stopping
from accelerated_evaluation.methods.problem import Problem, read_law_of
from accelerated_evaluation.methods.surrogate import Surrogate
from accelerated_evaluation.scenarios import SCENARIOS
from accelerated_evaluation.scenarios.protocol import Scenario
from accelerated_evaluation.vehicles import load_vehicle
from accelerated_evaluation.vehicles.protocol import event_named

RESULTS = Path(__file__).resolve().parent / "results" / "scenarios.csv"
SEEDS, FEW, MOST = 40, 150, 1000
AT_ONCE = 200_000  # draws of the law
TWICE = math.log(2)


def problem_of(scenario: Scenario, law: Path, event: str) -> Problem:
    """Return the problem of an event of the built-in car under a law."""
    car = load_vehicle(scenario.default_vehicle, scenario)
    return Problem(scenario, car, event_named(event, scenario), law=read_law_of(scenario, law))


def crude_probability(problem: Problem, draws: int) -> float:
    """Return the share of draws of the law that end in the event."""
    generator = child_generator(0, "scenario seeds", "crude")
    sizes = [min(AT_ONCE, draws - first) for first in range(0, draws, AT_ONCE)]
    outcomes = (problem.simulate(problem.law.draw(size, generator)) for size in sizes)
    return sum(int(problem.event.happens(each).sum()) for each in outcomes) / draws


def estimates(problem: Problem, seed: int) -> tuple[Estimate, Estimate]:
    """Return the estimate after at most `FEW` runs, and that after at most `MOST`."""
    stages: list[Estimate] = []
    method = Surrogate(on_batch=stages.append)
    stopping = Stopping(minimum_events=1, maximum_simulations=MOST)
    last = method.estimate(problem, stopping, child_generator(seed, "scenario seeds"))
    return [each for each in stages if each.simulations <= FEW][-1], last


def row_of(found: list[Estimate], truth: float, most: int) -> dict[str, float]:
    """Return how often estimates are right, and what they take."""
    numbers = [each for each in found if each.probability > 0]
    errors = np.array([abs(math.log(each.probability / truth)) for each in numbers])
    silent = [each.converged and error > TWICE for each, error in zip(numbers, errors, strict=True)]
    return {
        "at_most": most,
        "seeds": len(found),
        "simulations": float(np.mean([each.simulations for each in found])),
        "converged": float(np.mean([each.converged for each in found])),
        "covered": float(np.mean([each.covers(truth) for each in found])),
        "with_a_number": float(np.mean([each.high < 1 and each.probability > 0 for each in found])),
        "median_error": float(np.median(errors)) if errors.size else math.nan,
        "silently_off_by_2": int(sum(silent)),
    }


def add(table: pd.DataFrame, scenario: str, event: str) -> None:
    """Write the rows of an event in a scenario, and keep all others."""
    others = "scenario != @scenario or event != @event"
    before = [pd.read_csv(RESULTS).query(others)] if RESULTS.exists() else []
    shares = table.drop(columns="probability").round(6)
    write_csv(RESULTS, pd.concat([*before, table.assign(**shares)], ignore_index=True))


def main() -> None:
    """Run the seeds of one scenario, and write its rows after each of them."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("scenario", choices=sorted(set(SCENARIOS) - {"cut_in"}))
    parser.add_argument("law", type=Path)
    parser.add_argument("crude", type=int)
    parser.add_argument("--event", default="crash", help="crash or impact_speed=MIN_M_S (default: crash)")
    parser.add_argument("--seeds", type=int, default=SEEDS)
    arguments = parser.parse_args()
    scenario = SCENARIOS[arguments.scenario]
    problem = problem_of(scenario, arguments.law, arguments.event)
    truth, event = crude_probability(problem, arguments.crude), scenario.event_in_words(problem.event)
    named = {"scenario": scenario.name, "event": event}
    known = named | {"probability": float(f"{truth:.6g}"), "crude": arguments.crude}
    found = []
    for seed in range(1, arguments.seeds + 1):
        found.append(estimates(problem, seed))
        last = found[-1][1]
        print(seed, last.simulations, f"{last.probability:.3g}", last.converged, flush=True)
        pairs = zip((FEW, MOST), zip(*found, strict=True), strict=True)
        rows = [known | row_of(list(each), truth, most) for most, each in pairs]
        add(pd.DataFrame(rows), scenario.name, event)


if __name__ == "__main__":
    main()
