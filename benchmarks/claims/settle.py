"""Compare what the short repetition found with what is published: a table with a verdict for each claim.

    python benchmarks/claims/settle.py [PART ...]

The exit status is 1 if a claim is refuted. What is published is read from ``figures/spmd/tables`` and
``benchmarks/results``, from which the tables of the README are made.
"""

import argparse
import sys
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd
from accelerated_evaluation.base.errors import InputError
from accelerated_evaluation.base.files import write_csv
from accelerated_evaluation.laws.files import read_law
from accelerated_evaluation.methods.importance_sampling import crude_simulations
from accelerated_evaluation.records.encounter_table import read_encounters
from comparing import LEVEL, AtLeast, Claim, Exactly, Mean, Share

ROOT = Path(__file__).resolve().parents[2]
ALPHA = BETA = 0.2  # of the study
SEARCHES = 5  # replicates use the proposals of the searches in turn
REFITS = DRAWS = 500  # bootstrap refits and posterior draws of the study
QUANTILES = {"median": 0.5, "low50": 0.25, "high50": 0.75, "low80": 0.1, "high80": 0.9}
QUANTILES |= {"low95": 0.025, "high95": 0.975}
HUMAN = "cc_human"
NEAR_CRASH = "near-crash: cut-in in front of the subject, rear-end conflict"
CRASH = "crash: cut-in in front of the subject, rear-end conflict"


@dataclass(frozen=True)
class Files:
    """Where published and repeated tables are.

    Attributes
    ----------
    tables, benchmarks
        Published tables of the study, and of the benchmarks.
    study, raw
        Results of the repeated study, and of the repeated benchmarks.
    """

    tables: Path = ROOT / "figures" / "spmd" / "tables"
    benchmarks: Path = ROOT / "benchmarks" / "results"
    study: Path = Path("results/claims")
    raw: Path = Path("results/benchmarks/claims")

    def runs(self, name: str) -> pd.DataFrame:
        """Return all runs of a benchmark; they are in several files.

        Raises
        ------
        InputError
            If there are none.
        """
        paths = sorted(self.raw.glob(f"{name}*.csv"))
        if not paths:
            raise InputError(
                str(self.raw / f"{name}*.csv"),
                seen="no such file",
                expected="the runs of the short repetition",
                change="Let it run to its end.",
            )
        return pd.concat(map(pd.read_csv, paths), ignore_index=True)


FILES = Files()


def vehicle(files: Files) -> Iterator[Claim]:
    """Yield the claim about the outcomes of the vehicle."""
    found = files.runs("vehicle").iloc[0]
    published, repeated = (Exactly(f"{found[name]:,} of {found['published']:,}") for name in found.index)
    yield Claim("published outcomes that the simulator of the vehicle repeats", published, repeated)


def paper(files: Files) -> Iterator[Claim]:
    """Yield the claims about the paper's methods under the paper's model."""
    pairs = [
        (_probability(folder / "exact.csv"), _sizes(folder / "estimates.csv"))
        for folder in (files.tables, files.study)
    ]
    (probability, sizes), (found, found_sizes) = pairs
    yield Claim("crash probability of one lane change", probability, found)
    for method in ("piecewise", "single"):
        text = f"simulations to converge, {method}, mean"
        yield Claim(text, sizes[method], found_sizes[method])
    yield Claim("single / piecewise", *(size["single"].over(size["piecewise"]) for _, size in pairs))
    crude = [_crude(of_model) for of_model, _ in pairs]
    yield Claim("simulations to converge, crude Monte Carlo", *crude)
    ratios = (number.over(size["piecewise"]) for number, (_, size) in zip(crude, pairs, strict=True))
    yield Claim("crude / piecewise", *ratios)
    yield Claim("fitted parameters, piecewise", *_fitted(files))
    budgets = [
        pd.read_csv(folder / "uncertainty.csv").set_index("source") for folder in (files.tables, files.study)
    ]
    yield Claim(
        "share of sampling in the variance is under 1 %", *(_under(budget, 0.01) for budget in budgets)
    )
    yield Claim("share of finite data in the variance", *map(_share_of_data, budgets))


def _probability(path: Path) -> Mean:
    row = pd.read_csv(path).set_index("segment").loc["all"]
    return Mean(row["probability"], row["standard_error"])


def _sizes(path: Path) -> dict[str, Mean]:
    """Return the simulations to converge; replicates with the proposal of one search count as one value."""
    table = pd.read_csv(path).query("scope == 'all'")
    table["size"] = table["simulations" if "simulations" in table else "estimating"]
    by_search = table.groupby(["method", table["replicate"] % SEARCHES])["size"].mean()
    return {method: Mean.of(by_search[method]) for method in ("piecewise", "single")}


def _crude(probability: Mean) -> Mean:
    number = crude_simulations(probability.value, ALPHA, BETA)
    return Mean(number, number * probability.error / probability.value)


def _fitted(files: Files) -> tuple[Mean, Mean]:
    published = pd.read_csv(files.tables / "claims.csv").set_index("claim")["ours"]
    encounters = read_encounters(files.study / "encounters.parquet")
    law = read_law(files.study / "models" / "two_pieces.json", encounters)
    return Mean(published["fitted parameters, piecewise"]), Mean(law.n_parameters)


def _under(budget: pd.DataFrame, bound: float) -> Exactly:
    return Exactly("yes" if budget.loc["sampling", "variance_share"] < bound else "no")


def _share_of_data(budget: pd.DataFrame) -> Mean:
    """Return the share, with the standard error of a variance that `REFITS` normal values estimate."""
    share = budget.loc["data", "variance_share"]
    return Mean(share, share * (1 - share) * np.sqrt(2 / (REFITS - 1)), REFITS - 1)


def answer(files: Files) -> Iterator[Claim]:
    """Yield the claims about the recommended number; of the published draws only quantiles are kept."""
    published = pd.read_csv(files.tables / "answer.csv").set_index("event").loc["crash"]
    draws = pd.read_csv(files.study / "laws" / "answer_draws.csv")["probability"].to_numpy()
    mean = Mean.of(draws)
    yield Claim("crash of a cut-in, mean", Mean(published["probability"], mean.error, mean.freedom), mean)
    for name, level in QUANTILES.items():
        # As the normal quantiles of a binomial rank: a quantile lies between the draws at these two levels.
        reach = np.sqrt(level * (1 - level) / draws.size)
        low, high = np.quantile(draws, np.clip([level - reach, level + reach], 0, 1))
        error = (high - low) / 2
        found = Mean(np.quantile(draws, level), error, draws.size - 1)
        yield Claim(f"crash of a cut-in, {name}", Mean(published[name], error, draws.size - 1), found)


def counted(files: Files) -> Iterator[Claim]:
    """Yield the claims about predicted and counted crashes."""
    pair = [pd.read_csv(path / "counted_crashes.csv") for path in (files.tables, files.study)]
    yield Claim("vehicles whose predictions the counts contradict", *map(_contradicted, pair))
    yield Claim("crashes and near-crashes of the 100-Car study", *map(_of_hundred_cars, pair))
    yield Claim("predicted crashes of cc_human there", *map(_of_human, pair))


def _contradicted(table: pd.DataFrame) -> Exactly:
    return Exactly(", ".join(sorted(table.loc[table["verdict"] == "more than were counted", "who"])))


def _of_hundred_cars(table: pd.DataFrame) -> Exactly:
    counts = table[table["who"] == "100-Car"].set_index("what")["count"]
    return Exactly(" and ".join(f"{counts[what]:.0f}" for what in (CRASH, NEAR_CRASH)))


def _of_human(table: pd.DataFrame) -> Mean:
    """Return the number; its error is that of a mean of `DRAWS` draws whose 95 % interval is published."""
    row = table.set_index("who").loc[HUMAN]
    relative = (row["high95"] - row["low95"]) / (2 * 1.96) / row["per_million_miles"]
    return Mean(row["in_hundred_car"], row["in_hundred_car"] * relative / np.sqrt(DRAWS), DRAWS - 1)


def worlds(files: Files) -> Iterator[Claim]:
    """Yield the claims about the coverage of 80 % intervals, over all kinds of worlds."""
    table = pd.read_csv(files.benchmarks / "worlds.csv")
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
    runs = files.runs("estimate_")
    found = Mean.of(runs["simulations"])
    error = found.error * np.sqrt((found.freedom + 1) / row["seeds"])
    yield Claim("simulations of a whole answer", Mean(row["runs_mean"], error, row["seeds"] - 1), found)
    published = pd.read_csv(files.tables / "answer.csv").set_index("event").loc["crash"]
    # Both are medians of draws, with standard error 1 / (2 f √n), and the density f is from the quartiles.
    of_draws = (published["high50"] - published["low50"]) / np.sqrt(DRAWS)
    median = Mean.of(runs["median"])
    found = Mean(median.value, float(np.hypot(median.error, of_draws)), median.freedom)
    yield Claim("median of a whole answer", Mean(published["median"], of_draws, DRAWS - 1), found)


PARTS: dict[str, Callable[[Files], Iterator[Claim]]] = {
    part.__name__: part
    for part in (vehicle, paper, answer, counted, worlds, sampler, public, successor, estimate)
}


def settle(files: Files, parts: Iterable[str] = PARTS) -> pd.DataFrame:
    """Return a table with a row for each claim: part, claim, published, found, p_value, verdict."""
    rows = [
        {
            "part": f"{list(PARTS).index(part) + 1} {part}",
            "claim": claim.text,
            "published": str(claim.published),
            "found": str(claim.found),
            "p_value": f"{claim.likelihood:.2g}",
            "verdict": claim.verdict,
        }
        for part in parts
        for claim in PARTS[part](files)
    ]
    return pd.DataFrame(rows)


def main(arguments: Sequence[str] | None = None, files: Files = FILES) -> int:
    """Print the table, write it to ``claims.csv``, and return the exit status: 1 if a claim is refuted."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("parts", nargs="*", metavar="PART", help=f"of {', '.join(PARTS)}; all by default")
    asked = parser.parse_args(arguments).parts or list(PARTS)
    if unknown := [part for part in asked if part not in PARTS]:
        parser.error(f"unknown part {unknown[0]}; expected some of {', '.join(PARTS)}")
    try:
        table = settle(files, asked)
    except (InputError, FileNotFoundError) as error:
        print(f"error: {error}\nMake what is missing with: make claims", file=sys.stderr)
        return 2
    write_csv(files.raw / "claims.csv", table)
    print(table.to_markdown(index=False, disable_numparse=True))
    refuted = int((table["verdict"] == "refuted").sum())
    print(f"\n{len(table)} claims, {refuted} refuted (p < {LEVEL}).")
    return int(refuted > 0)


if __name__ == "__main__":
    sys.exit(main())
