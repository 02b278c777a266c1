"""Claims about the vehicle and about the methods, which the benchmarks test."""

from collections.abc import Iterator

import numpy as np
import pandas as pd
from accelerated_evaluation.answer.consequences.total import SIZE as VALUES
from accelerated_evaluation.answer.second_ways import LARGE, QUANTILES, errors_of_values
from comparing import AtLeast, Claim, Exactly, Mean, Share
from sources import Files

DRAWS = 500  # of the posterior, in the study
FEWEST = 5  # smallest number of seeds that know a number of a whole answer


def vehicle(files: Files) -> Iterator[Claim]:
    """Yield the claim about the outcomes of the vehicle."""
    found = files.runs("vehicle").iloc[0]
    published, repeated = (Exactly(f"{found[name]:,} of {found['published']:,}") for name in found.index)
    yield Claim("published outcomes that the simulator of the vehicle repeats", published, repeated)


def worlds(files: Files) -> Iterator[Claim]:
    """Yield the claims about the coverage of 80 % intervals, over the kinds of worlds like the models."""
    table = pd.read_csv(files.benchmarks / "worlds.csv").query("not beyond")
    runs = files.runs("worlds_")
    runs["covers"] = (runs["low0.8"] <= runs["truth"]) & (runs["truth"] <= runs["high0.8"])
    shares = {}
    for name in ("this project", "paper"):
        rows, found = table[table["procedure"] == name], runs[runs["procedure"] == name]
        hits = round((rows["coverage80"] * rows["worlds"]).sum())
        published = Share(hits, int(rows["worlds"].sum()))
        shares[name] = Claim(
            f"worlds that the 80 % intervals of {name} cover",
            published,
            Share(int(found["covers"].sum()), len(found)),
        )
    own = shares["this project"]
    yield Claim("coverage of these 80 % intervals", AtLeast(0.8), own.found)
    yield from shares.values()


def sampler(files: Files) -> Iterator[Claim]:
    """Yield the claims about the simulations on the main problem and about wrong estimates."""
    table = _main_problem(files)
    for method, name in {"surrogate": "this project", "piecewise": "the paper's piecewise method"}.items():
        yield Claim(f"simulations on the main problem, {name}", *_calls(files, table, method))
    row, runs = table.loc["surrogate"], files.runs("surrogate_")
    off = ~runs["probability"].between(row["reference"] / 2, row["reference"] * 2)
    published = Share(round(row["failed"] * row["seeds"]), int(row["seeds"]))
    yield Claim("runs that are wrong by more than a factor of 2", published, Share(int(off.sum()), len(off)))


def public(files: Files) -> Iterator[Claim]:
    """Yield the claim about the best public tool."""
    text = "simulations on the main problem, best public tool"
    yield Claim(text, *_calls(files, _main_problem(files), "nais_25"))


def _main_problem(files: Files) -> pd.DataFrame:
    table = pd.read_csv(files.benchmarks / "samplers.csv")
    return table[table["problem"] == "segment_5_15"].set_index("method")


def _calls(files: Files, table: pd.DataFrame, method: str) -> tuple[Mean, Mean]:
    row = table.loc[method]
    published = Mean(row["calls_mean"], row["calls_mean_se"], row["seeds"] - 1)
    return published, Mean.of(files.runs(f"{method}_")["calls"])


def successor(files: Files) -> Iterator[Claim]:
    """Yield the claim about the simulations that the runs of an older version save."""
    table, runs = pd.read_csv(files.benchmarks / "successors.csv"), files.runs("successor_")
    saved = 1 - runs["simulations"] / runs["simulations_alone"].mean()
    found = Mean.of(saved)
    published = 1 - table["simulations"].mean() / table["simulations_alone"].mean()
    # The table keeps no standard error. The published runs differ from these by their number alone.
    error = found.error * np.sqrt(len(runs) / table["seeds"].sum())
    yield Claim(
        "simulations saved by the runs of the old version", Mean(published, error, found.freedom), found
    )


def estimate(files: Files) -> Iterator[Claim]:
    """Yield the claims about whole answers from few simulations."""
    row = pd.read_csv(files.benchmarks / "answers.csv").set_index("vehicle").loc["acc_aeb"]
    runs, published = files.runs("estimate_"), pd.read_csv(files.tables / "answer.csv").set_index("event")
    crash = runs[runs["event"] == "crash"]
    found = Mean.of(crash["simulations"])
    error = found.error * np.sqrt((found.freedom + 1) / row["seeds"])
    yield Claim("simulations of a whole answer", Mean(row["runs_mean"], error, row["seeds"] - 1), found)
    # Quantiles of draws, in both: of those of the study, and of others.
    errors = np.sqrt(VALUES / DRAWS) * published.select_dtypes("number").apply(errors_of_values, axis=1)
    of_draws, median = errors.loc["crash", "median"], Mean.of(crash["median"])
    found = Mean(median.value, float(np.hypot(median.error, of_draws)), median.freedom)
    of_map = Mean(published.loc["crash", "median"], of_draws, DRAWS - 1)
    yield Claim("median of a whole answer", of_map, found)
    yield Claim(
        "numbers of whole answers that crash maps contradict", Exactly("none"), _far(runs, published, errors)
    )


def _far(runs: pd.DataFrame, published: pd.DataFrame, errors: pd.DataFrame) -> Exactly:
    """Return how many means over seeds of known numbers differ by more than `LARGE` errors from the maps'."""
    groups = runs.groupby("event")[[*QUANTILES]]
    mean, known = groups.mean(), groups.count() >= FEWEST
    together = np.sqrt(groups.sem() ** 2 + 2 * errors.loc[mean.index, mean.columns] ** 2)
    far = ((mean - published.loc[mean.index, mean.columns]).abs() > LARGE * together)[known]
    count = int(far.fillna(value=False).to_numpy().sum())
    return Exactly(f"{count} of {int(known.to_numpy().sum())}" if count else "none")
