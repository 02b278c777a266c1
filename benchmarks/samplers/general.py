"""Problems that the sampler was not made for: how often it claims a wrong answer, and how many runs it takes.

    python benchmarks/samplers/general.py benchmarks/results/general.csv [--kinds parts bulk] [--seeds 100]

The kinds are events with a part next to, behind or in front of the known one (`parts`), large batches
(`batches`), scores that jump and events of which the cover excludes little (`ends`), events in the bulk of
the law (`bulk`), and problems that any change must not make worse (`usual`). A row has the number of runs at
which the interval was narrow for the first time, and at the end. The estimates themselves are kept in a file
with the suffix `.seeds.csv`, from which an interrupted command continues; delete it after a change of the
sampler.
"""

import argparse
import math
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pandas as pd
from fewruns import Sampler, Stopping, SystemProblem, run_batches
from fewruns.running import sampler_for
from hidden_problems import ball, box, half_space, in_ball, in_box, union
from problems import problems
from public_problems import PublicProblem, public_problems
from scipy.integrate import quad, trapezoid
from scipy.stats import chi2, norm
from scipy.stats import t as student
from tqdm import tqdm

GOAL = Stopping(maximum_simulations=1000)
SAMPLERS = Path(__file__).parents[1] / "results" / "samplers.csv"
OFF = 0.5, 2.0  # an estimate is off outside of these multiples of the probability
AT = np.linspace(-9.0, 9.0, 4001)  # normal scores at which integrands are computed
Margin = Callable[[np.ndarray], np.ndarray]


@dataclass(frozen=True)
class Trial:
    """A problem, and the arguments with which the sampler is run on it."""

    problem: PublicProblem
    settings: dict[str, object] = field(default_factory=dict)
    seeds: int = 100


def scored(name: str, exact: float, dimension: int, score: Margin) -> PublicProblem:
    """Return the event that a score is at most 0."""
    return union(name, dimension, exact, score)


def in_steps(z: np.ndarray) -> np.ndarray:
    """Return the score of a car that is simulated in steps of 0.1 s: time to collision, less the impact.

    A cut-in begins at a range and a closing speed. The car brakes at the first step after its reaction time.
    """
    gap, speed = 30.0 * np.exp(-0.35 * z[:, 0]), 4.0 + 2.5 * np.exp(0.4 * z[:, 1])
    ttc, hit = np.full(len(z), np.inf), np.full(len(z), -1.0)
    for step in range(120):
        braking = 0.0 if step < 9 else 7.0
        crashed = gap <= 0
        hit = np.where(crashed & (hit < 0), speed, hit)
        ttc = np.where(~crashed & (speed > 0), np.minimum(ttc, gap / np.maximum(speed, 1e-9)), ttc)
        speed = np.maximum(speed - 0.1 * braking, 0.0)
        gap = np.where(crashed, gap, gap - 0.1 * speed)
    return np.where(hit > 0, -hit, np.minimum(ttc, 10.0))


def in_steps_exactly() -> float:
    """Return the probability that the car crashes; at each closing speed, it does below a certain range."""
    low, high = np.full(len(AT), -20.0), np.full(len(AT), 20.0)
    for _ in range(60):
        middle = (low + high) / 2
        crashes = in_steps(np.column_stack([middle, AT])) <= 0
        low, high = np.where(crashes, low, middle), np.where(crashes, middle, high)
    return float(trapezoid(norm.pdf(AT) * norm.sf(high), AT))


def student_sum(z: np.ndarray) -> np.ndarray:
    """Return how far the sum of three Student variables with three degrees of freedom is below 60."""
    return 60.0 - student.isf(norm.sf(z), 3).sum(axis=1)


def student_sum_exactly() -> float:
    """Return the probability that the sum exceeds 60, by integration over two of the variables."""
    x = student.isf(norm.sf(AT), 3)
    given = [trapezoid(norm.pdf(AT) * student.sf(60.0 - x - each, 3), AT) for each in x]
    return float(trapezoid(norm.pdf(AT) * given, AT))


def parts() -> Iterator[Trial]:
    """Yield events whose score is the distance to the nearer part; the sampler uses only its order."""
    plane, disc = half_space(4.2, 1, 0), ball(0.3, 2.6, 2.3)
    beside = norm.sf(4.2) + in_ball(0.3, math.hypot(2.6, 2.3), 2)
    yield Trial(union("disc_beside", 2, beside, plane, disc))
    exact = norm.sf(4.2) + in_ball(0.25, 3.2, 2)
    yield Trial(union("disc_between", 2, exact, plane, ball(0.25, 3.2, 0.0)))
    exact = norm.sf(4.2) + in_ball(0.3, math.hypot(3.1, 1.0), 2)
    yield Trial(union("disc_behind", 2, exact, plane, ball(0.3, -3.1, -1.0)))
    exact = in_ball(0.5, 4.2, 2) + in_ball(0.25, math.hypot(2.6, 2.2), 2)
    yield Trial(union("two_discs", 2, exact, ball(0.5, 4.2, 0.0), ball(0.25, 2.6, 2.2)))
    square = [1.5, -3.6], [2.0, -3.1]
    exact = norm.sf(4.3) + in_box(*square)
    yield Trial(union("square_beside", 2, exact, half_space(4.3, 1, 0), box(*square)))
    exact = norm.sf(4.2) + in_ball(0.5, math.hypot(2.6, 2.3), 3)
    yield Trial(union("ball_beside_3", 3, exact, half_space(4.2, 1, 0, 0), ball(0.5, 2.6, 2.3, 0.0)))
    exact = norm.sf(4.2) + in_ball(0.6, math.hypot(2.0, 2.4, 1.5), 3)
    yield Trial(union("ball_behind_3", 3, exact, half_space(4.2, 1, 0, 0), ball(0.6, -2.0, 2.4, 1.5)))


def batches() -> Iterator[Trial]:
    """Yield a half-plane, and problems with two parts, in batches of several sizes."""
    for size in (1, 5, 20, 32, 64):
        plane = union(f"plane_by_{size}", 2, norm.sf(4.0), half_space(4.0, 0.6, 0.8))
        yield Trial(plane, {"batch_size": size}, seeds=20)
    for size in (20, 64):
        regions = union(
            f"two_regions_by_{size}",
            2,
            norm.sf(4.2) + norm.sf(4.5),
            half_space(4.2, 1, 1),
            half_space(4.5, -1, -1),
        )
        yield Trial(regions, {"batch_size": size}, seeds=20)
    yield Trial(
        union("plane_upper_by_64", 2, norm.sf(4.0), half_space(4.0, 0.6, 0.8)),
        {"batch_size": 64, "upper_set": True},
        seeds=20,
    )


def ends() -> Iterator[Trial]:
    """Yield scores that jump, heavy tails, and events in three to six inputs."""
    yield Trial(scored("car_in_steps", in_steps_exactly(), 2, in_steps), seeds=20)
    yield Trial(scored("student_sum_3", student_sum_exactly(), 3, student_sum), seeds=20)

    def silent(z: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        return (z[:, 0] >= 4.2) | (z[:, 1] <= -4.3), 4.2 - z[:, 0]

    exact = 1 - norm.cdf(4.2) * norm.cdf(4.3)
    event = SystemProblem(silent, 3, fingerprint="silent_3", deterministic=True)
    yield Trial(PublicProblem("silent_3", event, exact=exact), seeds=20)
    top = norm.isf(1e-5 / 5)
    yield Trial(scored("maximum_5", 1 - norm.cdf(top) ** 5, 5, lambda z: top - z.max(axis=1)), seeds=20)
    dome = quad(lambda square: chi2.pdf(square, 5) * norm.sf(5.0 + 0.1 * square), 0, 100)[0]
    yield Trial(
        scored("dome_6", dome, 6, lambda z: 5.0 - z[:, 0] + 0.1 * (z[:, 1:] ** 2).sum(axis=1)), seeds=20
    )


def bulk() -> Iterator[Trial]:
    """Yield frequent events, and small ones where the law has most of its probability."""
    yield Trial(union("ball_at_origin", 2, 1 - math.exp(-(0.05**2) / 2), ball(0.05, 0.0, 0.0)), seeds=20)
    yield Trial(union("ball_near_origin", 2, in_ball(0.1, 0.7, 2), ball(0.1, 0.5, -0.5)), seeds=20)
    ring = chi2.sf(1.0, 2) - chi2.sf(1.017, 2)
    yield Trial(scored("torus_2", ring, 2, lambda z: np.abs(np.hypot(*z.T) - 1.004225) - 0.004225), seeds=20)
    yield Trial(scored("frequent_3", norm.sf(1.5), 3, lambda z: 1.5 - z[:, 0]), seeds=20)


def usual() -> Iterator[Trial]:
    """Yield problems that a change must not make worse."""
    textbook, public = problems(), public_problems()
    reference = pd.read_csv(SAMPLERS).groupby("problem")["reference"].first()
    for name in ("segment_5_15", "circle", "two_regions", "plane_6", "ball_4"):
        exact = textbook[name].exact or float(reference[name])
        yield Trial(PublicProblem(name, textbook[name].event, exact=exact), seeds=24)
    four = textbook["four_branches"]
    inside = quad(lambda v: norm.pdf(v) * (1 - 2 * norm.sf(5 + 0.2 * v * v)), -4.5, 4.5)[0]
    yield Trial(PublicProblem("four_branches", four.event, exact=1 - inside), seeds=24)
    yield Trial(union("plane_flags", 2, norm.sf(4.2), half_space(4.2, 1, 0)), seeds=24)
    for name in ("rp_22", "rp_53", "r_minus_s"):
        yield Trial(public[name], seeds=24)


KINDS = {"parts": parts, "batches": batches, "ends": ends, "bulk": bulk, "usual": usual}


def row(kind: str, trial: Trial, seed: int) -> dict[str, object]:
    """Return what one seed gave."""
    begin = time.perf_counter()
    event = trial.problem.event
    sampler = sampler_for(event, np.random.default_rng(seed), **trial.settings)
    narrow = narrow_at(sampler, trial)
    found, exact = sampler.estimate(GOAL), trial.problem.exact or trial.problem.published
    return {
        "kind": kind,
        "problem": trial.problem.name,
        "seed": seed,
        "ratio": found.probability / exact,
        "low": found.low / exact,
        "high": found.high / exact,
        "narrow": narrow,
        "runs": found.simulations,
        "converged": found.converged,
        "seconds": time.perf_counter() - begin,
    }


def narrow_at(sampler: Sampler, trial: Trial) -> float:
    """Run the batches of a sampler to the end; return when the interval last became narrow."""
    narrow = math.nan
    for _ in run_batches(sampler, trial.problem.event, GOAL):
        if not sampler.is_narrow(GOAL):
            narrow = math.nan
        elif math.isnan(narrow):
            narrow = sampler.simulations
    return narrow


def summary(runs: pd.DataFrame) -> pd.DataFrame:
    """Return a row for each problem."""
    is_off = ~runs["ratio"].between(*OFF) & runs["ratio"].notna()
    runs = runs.assign(claimed_off=is_off & runs["converged"], rest=runs["runs"] - runs["narrow"])
    runs = runs.assign(covered=(runs["low"] <= 1) & (runs["high"] >= 1))
    groups = runs.groupby(["kind", "problem"], sort=False)
    return groups.agg(
        seeds=("seed", "size"),
        converged=("converged", "sum"),
        claimed_off=("claimed_off", "sum"),
        median=("ratio", "median"),
        covered=("covered", "mean"),
        narrow=("narrow", "mean"),
        runs=("runs", "mean"),
        most_runs=("runs", "max"),
        most_rest=("rest", "max"),
        seconds=("seconds", "mean"),
    ).reset_index()


def main() -> None:
    """Run all trials, and write the table."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("output", type=Path, help="where to write the table")
    parser.add_argument("--kinds", nargs="+", choices=KINDS, default=[*KINDS])
    parser.add_argument("--problems", nargs="+", help="default: all")
    parser.add_argument("--seeds", type=int, default=100, help="at most; default: 100")
    arguments = parser.parse_args()
    trials = [(kind, trial) for kind in arguments.kinds for trial in KINDS[kind]()]
    trials = [t for t in trials if not arguments.problems or t[1].problem.name in arguments.problems]
    tasks = [(*trial, seed) for seed in range(arguments.seeds) for trial in trials if seed < trial[1].seeds]
    kept = arguments.output.with_suffix(".seeds.csv")
    rows = pd.read_csv(kept).to_dict("records") if kept.exists() else []
    made = {(each["problem"], each["seed"]) for each in rows}
    for kind, trial, seed in tqdm(tasks):  # one seed of all problems before the next: a table is made early
        if (trial.problem.name, seed) not in made:
            rows.append(row(kind, trial, seed))
            pd.DataFrame(rows).to_csv(kept, index=False)
    summary(pd.DataFrame(rows)).round(3).to_csv(arguments.output, index=False)


if __name__ == "__main__":
    main()
