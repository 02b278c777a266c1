"""Plain importance sampling under all draws of a law: a second way to the answer of a study of cut-ins.

Run as ``python benchmarks/second_ways.py`` after ``make study``. It prints every number of the table of
answers with the same number by plain importance sampling, its error, and the difference in errors, and ends
with the status 1 if a number is more than 4 errors away.

Encounters are drawn from a wide density that knows nothing of a vehicle: no crash map, no surrogate and no
search. All vehicles are simulated in the same encounters, and every probability is a weighted count. The
encounters are scrambled Sobol points in independent batches. Each statistic of the probabilities, such as
their median over the draws of the law, has a jackknife error from the batches, whatever the statistic is.
"""

import sys
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd
from accelerated_evaluation.answer.fitted_records import stored_records
from accelerated_evaluation.answer.posterior import Posterior, answer_row
from accelerated_evaluation.answer.settings import support_of
from accelerated_evaluation.base.arrays import Array
from accelerated_evaluation.base.files import read_json
from accelerated_evaluation.laws.draws import as_draws
from accelerated_evaluation.laws.files import read_law
from accelerated_evaluation.scenarios.cut_in import CUT_IN
from accelerated_evaluation.vehicles.loading import load_vehicle
from accelerated_evaluation.vehicles.protocol import events_of
from scipy.stats import qmc

BATCHES, SIZE = 16, 2**14  # number of independent batches, and of the encounters in each
FAR = 4.0  # number of errors from which on two numbers contradict each other
STUDY = Path(__file__).resolve().parents[1] / "results" / "spmd"
NEAREST = 0.02  # [m], smallest range of a cut-in that is drawn; nearly no cut-in of any law is nearer
ATOM, SLOW = (
    0.05,
    0.45,
)  # shares of the cut-ins at the cap on the closing speed, and of those that close slowly
TYPICAL = 2.0  # [m/s], mean closing speed of those

Features = Callable[[Array], Mapping[str, Array]]
"""Function that returns columns for n encounters, (n, d), whose mean under a law is sought, each (n, m)."""
Density = Callable[[Array], Array]
"""Function that returns the log density of n encounters, (n, d), under each of K laws, shape (K, n)."""
Means = Mapping[str, Array]
"""Means of features under each law, shape (K, m) each."""


@dataclass(frozen=True)
class WideCutIns:
    """Cut-ins with recorded lead speeds, ranges on a logarithmic scale and all closing speeds up to a cap."""

    lead_speed: Array  # the recorded values [m/s], shape (records,)
    range_max: float  # [m]
    cap: float  # [m/s]; the laws have a probability at this closing speed

    dimension = 4

    def points(self, u: Array) -> tuple[Array, Array]:
        """Map uniform numbers, (n, 4), to cut-ins, (n, 3), with the log of their density given v_L, (n,)."""
        speeds = np.sort(self.lead_speed)
        lead = speeds[(u[:, 0] * speeds.size).astype(int)]
        width = np.log(self.range_max / NEAREST)
        range_ = NEAREST * np.exp(u[:, 1] * width)
        below = -np.expm1(-self.cap / TYPICAL)
        kind = u[:, 2]
        closing = np.where(kind < ATOM + SLOW, -TYPICAL * np.log1p(-u[:, 3] * below), self.cap * u[:, 3])
        closing = np.where(kind < ATOM, self.cap, closing)
        slow = np.exp(-closing / TYPICAL) / (TYPICAL * below)
        density = np.where(closing >= self.cap, ATOM, SLOW * slow + (1 - ATOM - SLOW) / self.cap)
        return np.column_stack([lead, range_, closing]), np.log(density / (range_ * width))


@dataclass(frozen=True)
class Plain:
    """Means of features under K laws, by independent batches."""

    sums: Mapping[str, Array]  # mean of each feature in each batch, shape (batches, K, m)

    @classmethod
    def of(
        cls, wide: WideCutIns, density: Density, features: Features, generator: np.random.Generator
    ) -> "Plain":
        """Draw the encounters of all batches, and weight their features by the density of each law."""
        parts: list[Means] = []
        for _ in range(BATCHES):
            u = qmc.Sobol(wide.dimension, rng=generator).random(SIZE)
            x, log_density = wide.points(u)
            columns = {name: each.astype(float) for name, each in features(x).items()}
            needed = np.any([each.any(axis=1) for each in columns.values()], axis=0)
            weights = np.exp(density(x[needed]) - log_density[needed]) / SIZE
            parts.append({name: weights @ each[needed] for name, each in columns.items()})
        return cls({name: np.stack([part[name] for part in parts]) for name in parts[0]})

    def means(self, left_out: int | None = None) -> Means:
        """Return the means of the features, (K, m) each, of all batches but one."""
        return {
            name: (each if left_out is None else np.delete(each, left_out, axis=0)).mean(axis=0)
            for name, each in self.sums.items()
        }

    def tables(
        self, made: Callable[[Means], Mapping[str, pd.DataFrame]]
    ) -> Iterator[tuple[str, pd.DataFrame, pd.DataFrame]]:
        """Yield the name of each table that follows from the means, the table, and its jackknife errors."""
        whole, parts = made(self.means()), [made(self.means(each)) for each in range(BATCHES)]
        for name, table in whole.items():
            numbers = table.select_dtypes("number").astype(float)
            values = np.stack([part[name][numbers.columns].to_numpy(float) for part in parts])
            squares = ((values - values.mean(axis=0)) ** 2).sum(axis=0) * (BATCHES - 1) / BATCHES
            yield name, table, pd.DataFrame(np.sqrt(squares), columns=numbers.columns)


def compared_answer(study: Path, generator: np.random.Generator) -> pd.DataFrame:
    """Return each number of the table of answers with that of plain importance sampling, one row each."""
    config = read_json(study / "config.json")
    support = support_of(CUT_IN, config)
    exposure = read_json(study / "exposure.json")
    content = None if support is None else support.content()
    records = stored_records(CUT_IN, study / "encounters.parquet", content, exposure)
    draws = as_draws(read_law(study / "laws" / "draws.json", records.table))
    vehicle = load_vehicle(config["vehicle"]["name"], CUT_IN, **config["vehicle"]["parameters"])
    events = [CUT_IN.events[0], *events_of(CUT_IN, config["answer"]["events"])]

    def features(x: Array) -> dict[str, Array]:
        outcomes = vehicle.simulate(*CUT_IN.to_inputs(x).T)
        return {"events": np.column_stack([event.happens(outcomes) for event in events])}

    def made(means: Means) -> dict[str, pd.DataFrame]:
        rows = [
            {"event": CUT_IN.event_in_words(event)} | answer_row(Posterior(values, draws.member))
            for event, values in zip(events, means["events"].T, strict=True)
        ]
        return {"answer": pd.DataFrame(rows)}

    wide = WideCutIns(records.x[:, 0], draws.support.range_max, draws.proposal.closing_speed_max)
    plain = Plain.of(wide, draws.log_densities, features, generator)
    ((_, second, errors),) = plain.tables(made)
    published = pd.read_csv(study / "laws" / "answer.csv").set_index("event").loc[second["event"]]
    rows = [
        (event, column, published.loc[event, column], second.loc[k, column], errors.loc[k, column])
        for k, event in enumerate(second["event"])
        for column in errors
    ]
    table = pd.DataFrame(rows, columns=["event", "column", "number", "second", "error"])
    return table.assign(difference=(table["number"] - table["second"]) / table["error"])


if __name__ == "__main__":
    found = compared_answer(STUDY, np.random.default_rng(1))
    print(found.to_string(index=False, float_format="{:.3g}".format))
    sys.exit(int((found["difference"].abs() > FAR).any()))
