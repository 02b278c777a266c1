"""The sampler before cars that do not repeat themselves: truth in closed form, and many seeds.

    python benchmarks/samplers/chance.py run lapses_0.01 noise_0.3 --seeds 0 40 --output runs.csv
    python benchmarks/samplers/chance.py table runs.csv --output benchmarks/results/chance.csv

The first command writes every seed as soon as it is finished, and does not repeat the seeds that are in the
file. The second command replaces the rows of the problems that were run, and keeps all other rows.

Every problem here has a known probability. A car that drives like another one in a share of its runs crashes
as often as the mixture of both. Noise that turns the normal scores z into rho z + sqrt(1 - rho^2) e leaves
their law as it is, and so the probability. A half-space with probit noise of standard deviation s at the
distance b has the probability Phi(-b / sqrt(1 + s^2)); `least_runs` says how many runs it costs at least.
"""

import argparse
import math
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pandas as pd
from accelerated_evaluation.base.arrays import Array
from accelerated_evaluation.base.files import write_csv
from accelerated_evaluation.base.randomness import child_generator
from accelerated_evaluation.methods.surrogate import Surrogate
from accelerated_evaluation.vehicles import AccAeb, Outcomes, Vehicle, load_vehicle
from fewruns.problems import Response, ScoreProblem, SystemProblem
from methods import Target
from problems import BENCHMARK, derived, problems, segment_problem
from run import ROOT
from scipy.integrate import quad
from scipy.special import log_ndtr, ndtr
from scipy.stats import binomtest

RESULTS = Path(__file__).resolve().parents[1] / "results"
LIMIT = 1000  # simulations after which the sampler gives up, as in the other tables
CLOSING = 5.0  # [m/s]
SECONDS = 8.0
LARGEST = 12.0  # normal score beyond which nothing is added to an integral
DRAWS = 1_000_000  # that say how frequent a kind of cut-in is


@dataclass
class Lapsing:
    """A car that drives like another one in a share of its runs."""

    car: Vehicle
    other: Vehicle
    rate: float
    generator: np.random.Generator = field(repr=False, compare=False)
    deterministic: bool | None = False

    def simulate(self, lead_speed: Array, range_: Array, closing_speed: Array) -> Outcomes:
        """Simulate n cut-ins; see `Vehicle`."""
        outcomes = [car.simulate(lead_speed, range_, closing_speed) for car in (self.car, self.other)]
        lapse = self.generator.random(len(range_)) < self.rate
        own, others = (vars(each) for each in outcomes)
        return Outcomes(**{name: np.where(lapse, others[name], own[name]) for name in own})


@dataclass(frozen=True)
class Unbraked:
    """A car that keeps its speed for eight seconds."""

    def simulate(self, lead_speed: Array, range_: Array, closing_speed: Array) -> Outcomes:
        """Simulate n cut-ins; see `Vehicle`."""
        left = range_ - SECONDS * np.maximum(closing_speed, 0.0)
        crash = left <= 0
        nearest = np.divide(left, closing_speed, out=np.full(len(left), np.inf), where=closing_speed > 0)
        return Outcomes(crash, left, np.where(crash, 1e-3, nearest), np.where(crash, closing_speed, 0.0))


@dataclass(frozen=True)
class Striking:
    """A car that drives like another one, but crashes in all cut-ins that close in fast."""

    car: Vehicle

    def simulate(self, lead_speed: Array, range_: Array, closing_speed: Array) -> Outcomes:
        """Simulate n cut-ins; see `Vehicle`."""
        own = self.car.simulate(lead_speed, range_, closing_speed)
        strikes = (np.asarray(closing_speed) > CLOSING) & ~own.crash
        return Outcomes(
            own.crash | strikes,
            np.where(strikes, 0.0, own.min_range),
            np.where(strikes, 1e-3, own.min_ttc),
            np.where(strikes, closing_speed, own.impact_speed),
        )


def shaken(event: ScoreProblem, spread: float, generator: np.random.Generator) -> SystemProblem:
    """Return an event whose normal scores are disturbed in every run, which leaves their law as it is."""

    def respond(z: Array) -> Response:
        noise = generator.standard_normal(z.shape)
        return event.evaluate(math.sqrt(1 - spread**2) * z + spread * noise)

    name = f"{event.fingerprint}, disturbed by {spread}"
    return derived(event, respond, fingerprint=name, deterministic=False, upper_set=False)


@dataclass(frozen=True)
class Chance:
    """A problem with chance in its outcomes: how it is made from a generator, and its probability."""

    make: Callable[[np.random.Generator], ScoreProblem]
    exact: float


def reference(name: str) -> float:
    """Return the probability of a problem of the benchmark, from its table."""
    table = pd.read_csv(RESULTS / "samplers.csv")
    return float(table.loc[table["problem"] == name, "reference"].iloc[0])


def noisy_plane(distance: float, spread: float, *, declared: bool | None = None) -> Chance:
    """Return a half-space in two inputs whose score, and with it the flag, has normal noise."""

    def make(generator: np.random.Generator) -> ScoreProblem:
        def respond(z: Array) -> Response:
            score = distance - z.sum(1) / math.sqrt(2) + spread * generator.standard_normal(len(z))
            return score <= 0, score

        return SystemProblem(respond, 2, fingerprint="noisy half-space", deterministic=declared)

    return Chance(make, float(ndtr(-distance / math.sqrt(1 + spread**2))))


def least_runs(distance: float, spread: float, error: float = 0.156) -> float:
    """Return the runs that any unbiased estimate from flags needs for a noisy half-space, without learning.

    With the density h of the runs and the control variate g, a run has the variance E_h (phi / h)^2 p (1 - p)
    at least, which g = p attains. It is least for h proportional to phi sqrt(p (1 - p)).

    Parameters
    ----------
    distance, spread
        The half-space, and the standard deviation of its noise.
    error
        Required coefficient of variation.
    """

    def integrand(x: float) -> float:
        log_p, log_rest = log_ndtr([(x - distance) / spread, (distance - x) / spread])
        return math.exp((log_p + log_rest - x * x) / 2) / math.sqrt(2 * math.pi)

    root = quad(integrand, -LARGEST, LARGEST, points=[distance], limit=200)[0]
    return float((root / ndtr(-distance / math.hypot(1, spread)) / error) ** 2)


def lapsing(
    other: Vehicle, rate: float, exact: float | None = None, *, declared: bool | None = False
) -> Chance:
    """Return the study's car that drives like another one in a share of its runs.

    Parameters
    ----------
    other, exact
        The other car, and its probability, which is found by many draws if it is None.
    rate
        The share of the runs.
    declared
        What the car says of its determinism.
    """

    def make(generator: np.random.Generator) -> ScoreProblem:
        return segment_problem("5-15", Lapsing(AccAeb(), other, rate, generator, declared), BENCHMARK)

    others = share_of(other) if exact is None else exact
    return Chance(make, (1 - rate) * reference("segment_5_15") + rate * others)


def human(rate: float, *, declared: bool | None = False) -> Chance:
    """Return the study's car that drives like the competent and careful human in a share of its runs."""
    return lapsing(load_vehicle("cc_human"), rate, reference("driver_cc_human"), declared=declared)


def share_of(vehicle: Vehicle) -> float:
    """Return the share of the cut-ins of the main problem in which a vehicle crashes, by many draws."""
    z = child_generator(ROOT, "chance", "shares").standard_normal((DRAWS, 3))
    return float(segment_problem("5-15", vehicle, BENCHMARK).evaluate(z)[0].mean())


def striped(name: str) -> Chance:
    """Return a vehicle that crashes in thin stripes; crude Monte Carlo gives its probability to about 1 %."""
    vehicle = load_vehicle(name)
    return Chance(lambda _: segment_problem("5-15", vehicle, BENCHMARK), share_of(vehicle))


def shaken_main(spread: float) -> Chance:
    """Return the crash of the main problem with disturbed scores."""
    own = problems()["segment_5_15"].event
    return Chance(lambda generator: shaken(own, spread, generator), reference("segment_5_15"))


PROBLEMS: dict[str, Callable[[], Chance]] = {
    "half_space": lambda: noisy_plane(4.5, 0.0, declared=True),
    "lapses_0.01": lambda: human(0.01),
    "lapses_0.1": lambda: human(0.1),
    "lapses_0.01_undeclared": lambda: human(0.01, declared=None),
    "lapses_0.1_undeclared": lambda: human(0.1, declared=None),
    "no_brakes_0.01": lambda: lapsing(Unbraked(), 0.01),
    "no_brakes_0.01_undeclared": lambda: lapsing(Unbraked(), 0.01, declared=None),
    "careless_0.01_undeclared": lambda: lapsing(Striking(AccAeb()), 0.01, declared=None),
    "careless_0.01": lambda: lapsing(Striking(AccAeb()), 0.01),
    "shaken_0.1": lambda: shaken_main(0.1),
    "noise_0.1": lambda: noisy_plane(4.5, 0.1),
    "noise_0.3": lambda: noisy_plane(4.5, 0.3),
    "reg157": lambda: striped("reg157"),
}


def run_seeds(names: list[str], seeds: range, path: Path, limit: int) -> None:
    """Run the sampler on some problems, and write a row for each seed that is not yet in the file.

    Parameters
    ----------
    names, seeds
        The problems, and the seeds of each.
    path
        The file.
    limit
        Simulations after which a seed ends.
    """
    rows = pd.read_csv(path).to_dict("records") if path.exists() else []
    known = {(row["problem"], row["seed"]) for row in rows}
    for name in names:
        chance = PROBLEMS[name]()
        for seed in seeds:
            if (name, seed) in known:
                continue
            rows.append({"problem": name, "seed": seed, **run(name, chance, seed, limit)})
            write_csv(path, pd.DataFrame(rows))
            print(rows[-1], flush=True)


def run(name: str, chance: Chance, seed: int, limit: int) -> dict[str, float]:
    """Return what the sampler gave on a problem with one seed."""
    start = time.perf_counter()
    event = chance.make(child_generator(ROOT, name, "chance of the car", seed))
    found = Surrogate().estimate(
        event,
        Target(minimum_events=1, maximum_simulations=limit),
        child_generator(ROOT, name, "chance", seed),
    )
    return {
        "exact": chance.exact,
        "probability": found.probability,
        "low": found.low,
        "high": found.high,
        "simulations": found.simulations,
        "converged": found.converged,
        "seconds": round(time.perf_counter() - start, 2),
    }


def table(runs: pd.DataFrame) -> pd.DataFrame:
    """Sum up the runs, a row a problem."""
    rows = []
    for name, own in runs.groupby("problem", sort=False):
        exact = float(own["exact"].iloc[0])
        done = own[own["converged"]]
        ratio = done["probability"] / exact
        off = int(((ratio < 0.5) | (ratio > 2)).sum())
        covered = int(((done["low"] <= exact) & (exact <= done["high"])).sum())
        ends = binomtest(covered, len(done)).proportion_ci(0.95, "exact") if len(done) else (math.nan,) * 2
        held = ((own["low"] <= exact) & (exact <= own["high"])).mean()
        rows.append(
            {
                "problem": name,
                "exact": exact,
                "seeds": len(own),
                "converged": len(done),
                "simulations": own["simulations"].mean(),
                "ratio": ratio.mean(),
                "error": math.sqrt(((ratio - 1) ** 2).mean()) if len(done) else math.nan,
                "covered": covered,
                "coverage_low": ends[0],
                "coverage_high": ends[1],
                "off": off,
                "covered_all": held,
            }
        )
    return pd.DataFrame(rows)


def updated(path: Path, runs: pd.DataFrame) -> pd.DataFrame:
    """Return the table in a file with the rows of the given runs, old rows of other problems included."""
    new = table(runs)
    old = pd.read_csv(path) if path.exists() else new.iloc[:0]
    merged = pd.concat([old, new]).drop_duplicates("problem", keep="last")
    return merged.sort_values("problem", key=lambda names: names.map(list(PROBLEMS).index))


def main() -> None:
    """Run some problems, or sum up all runs."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    steps = parser.add_subparsers(dest="step", required=True)
    running = steps.add_parser("run", help="estimate problems with some seeds")
    running.add_argument("problems", choices=PROBLEMS, nargs="+", metavar="problem")
    running.add_argument("--seeds", type=int, nargs=2, metavar=("FIRST", "END"), required=True)
    running.add_argument("--limit", type=int, default=LIMIT, help="simulations (default: %(default)s)")
    summed = steps.add_parser("table", help="sum up all runs")
    summed.add_argument("runs", nargs="+")
    for step in (running, summed):
        step.add_argument("--output", type=Path, required=True)
    asked = parser.parse_args()
    if asked.step == "run":
        run_seeds(asked.problems, range(*asked.seeds), asked.output, asked.limit)
    else:
        runs = pd.concat([pd.read_csv(path) for path in asked.runs])
        write_csv(asked.output, updated(asked.output, runs))


if __name__ == "__main__":
    main()
