"""Claims about the study: the paper's numbers, the answer, counted crashes and injuries."""

from collections.abc import Iterator

import numpy as np
import pandas as pd
from accelerated_evaluation.answer.second_ways import LARGE
from accelerated_evaluation.laws.files import read_law
from accelerated_evaluation.methods.importance_sampling import crude_simulations
from accelerated_evaluation.records.segments import read_encounters
from comparing import Between, Claim, Exactly, Mean
from sources import Files

ALPHA = BETA = 0.2  # of the study
SEARCHES = 5  # replicates use the proposals of the searches in turn
REFITS = DRAWS = 500  # bootstrap refits and posterior draws of the study
QUANTILES = {"median": 0.5, "low50": 0.25, "high50": 0.75, "low80": 0.1, "high80": 0.9}
QUANTILES |= {"low95": 0.025, "high95": 0.975}
HUMAN, DRIVER, TESTED = "cc_human", "human", "under test"
NEAR_CRASH = "near-crash: cut-in in front of the subject, rear-end conflict"
CRASH = "crash: cut-in in front of the subject, rear-end conflict"
PREDICTED = ("crash", "near-crash, 0.5 g")  # events of the human driver
CLOSING, OPENING = "closing", "opening"  # kinds of gaps in the table of lead motion
RATIO, MOVING = ["factor", "factor_error"], ["moving", "standard_error"]  # of that table, with errors
SERIOUS, DISTANCE = "MAIS3+", "million kilometres"


def paper(files: Files) -> Iterator[Claim]:
    """Yield the claims about the paper's methods under the paper's model."""
    probability = [*map(_probability, files.pair("exact.csv"))]
    sizes = [*map(_sizes, files.pair("estimates.csv"))]
    yield Claim("crash probability of one lane change", *probability)
    for method in ("piecewise", "single"):
        yield Claim(f"simulations to converge, {method}, mean", *(size[method] for size in sizes))
    ratios = (size["single"].over(size["piecewise"]) for size in sizes)
    yield Claim("single / piecewise, of the replicates", *ratios)
    crude = [*map(_crude, probability)]
    yield Claim("simulations to converge, crude Monte Carlo", *crude)
    ratios = (number.over(size["piecewise"]) for number, size in zip(crude, sizes, strict=True))
    yield Claim("crude / piecewise, of the replicates", *ratios)
    yield Claim("fitted parameters, piecewise", *_fitted(files))
    budgets = [budget.set_index("source")["variance_share"] for budget in files.pair("uncertainty.csv")]
    small = (Exactly("yes" if budget["sampling"] < 0.01 else "no") for budget in budgets)
    yield Claim("share of sampling in the variance is under 1 %", *small)
    yield Claim(
        "share of finite data in the variance", *(_share(budget["data"], REFITS) for budget in budgets)
    )


def _probability(table: pd.DataFrame) -> Mean:
    row = table.set_index("segment").loc["all"]
    return Mean(row["probability"], row["standard_error"])


def _sizes(table: pd.DataFrame) -> dict[str, Mean]:
    """Return the simulations to converge; replicates with the proposal of one search count as one value."""
    table = table.query("scope == 'all'")
    size = table["simulations" if "simulations" in table else "estimating"]
    by_search = size.groupby([table["method"], table["replicate"] % SEARCHES]).mean()
    return {method: Mean.of(by_search[method]) for method in ("piecewise", "single")}


def _crude(probability: Mean) -> Mean:
    number = crude_simulations(probability.value, ALPHA, BETA)
    return Mean(number, number * probability.error / probability.value)


def _fitted(files: Files) -> tuple[Mean, Mean]:
    published = pd.read_csv(files.tables / "claims.csv").set_index("claim")["ours"]
    encounters = read_encounters(files.study / "encounters.parquet")
    law = read_law(files.study / "models" / "two_pieces.json", encounters)
    return Mean(published["fitted parameters, piecewise"]), Mean(law.n_parameters)


def _share(share: float, values: int) -> Mean:
    """Return a share of a variance, with the standard error of one that normal ``values`` estimate."""
    return Mean(share, share * (1 - share) * np.sqrt(2 / (values - 1)), values - 1)


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
    yield _second(files.runs("explored"), "starting numbers of the explorer that plain sampling contradicts")


def counted(files: Files) -> Iterator[Claim]:
    """Yield the claims about predicted and counted crashes."""
    pair = files.pair("counted_crashes.csv")
    yield Claim("vehicles whose predictions the counts contradict", *map(_contradicted, pair))
    yield Claim("crashes and near-crashes of the 100-Car study", *map(_of_hundred_cars, pair))
    yield Claim("predicted crashes of cc_human there", *map(_of_human, pair))
    published, found = (
        table[table["driver"] == DRIVER].set_index("event") for table in files.pair("human_predictions.csv")
    )
    for event in PREDICTED:
        # The map of this driver averages over a finite number of drawn drivers, whose error is not published.
        limits = Between(published.loc[event, "low90"], published.loc[event, "high90"])
        text = f"expected number for the driver `human`, 90 % limits: {event}"
        yield Claim(text, limits, Mean(found.loc[event, "expected"]))
    yield _second(
        files.runs("human_variants"), "variants of the human driver that plain sampling contradicts"
    )


def _contradicted(table: pd.DataFrame) -> Exactly:
    return Exactly(", ".join(sorted(table.loc[table["verdict"] == "more than were counted", "who"])))


def _of_hundred_cars(table: pd.DataFrame) -> Exactly:
    counts = table[table["who"] == "100-Car"].set_index("what")["count"]
    return Exactly(" and ".join(f"{counts[what]:.0f}" for what in (CRASH, NEAR_CRASH)))


def _of_human(table: pd.DataFrame) -> Mean:
    """Return the number; its error is that of a mean of `DRAWS` draws with the published 95 % interval."""
    row = table.set_index("who").loc[HUMAN]
    relative = (row["high95"] - row["low95"]) / (2 * 1.96) / row["per_million_miles"]
    return Mean(row["in_hundred_car"], row["in_hundred_car"] * relative / np.sqrt(DRAWS), DRAWS - 1)


def motion(files: Files) -> Iterator[Claim]:
    """Yield the claims about a lead vehicle that changes its speed."""
    pair = [table.set_index(["vehicle", "gap"]) for table in files.pair("lead_motion.csv")]
    for vehicle in (TESTED, HUMAN):
        text = f"crash probability with lead motion / with a constant lead speed, {vehicle}"
        yield Claim(text, *(Mean(*table.loc[(vehicle, CLOSING), RATIO]) for table in pair))
    text = f"crash probability of cut-ins whose gap opens, {TESTED}"
    yield Claim(text, *(Mean(*table.loc[(TESTED, OPENING), MOVING]) for table in pair))
    yield _second(files.runs("moving_leads"), "numbers of lead motion that plain sampling contradicts")


def injuries(files: Files) -> Iterator[Claim]:
    """Yield the claims about injured drivers, and about the curves of the risk of injury."""
    pair = files.pair("laws/injuries.csv")
    for level in pair[0]["level"].unique():
        text = f"drivers per million kilometres, injury {level}, median"
        yield Claim(text, *(_injured(table, level) for table in pair))
    budgets = [table.set_index(["level", "source"]) for table in files.pair("laws/injury_budget.csv")]
    of_curve = (budget.loc[(SERIOUS, "choice of curve"), "variance_share"] for budget in budgets)
    yield Claim(
        f"share of the choice of curve, injury {SERIOUS}", *(_share(each, DRAWS) for each in of_curve)
    )
    ratios = map(_ratio_to_human, files.pair("laws/risk_balance.csv"))
    yield Claim(f"ratio to cc_human, injury {SERIOUS}", *ratios)


def scenarios(files: Files) -> Iterator[Claim]:
    """Yield the claims that counts agree with the answers of other scenarios than the cut-in."""
    for study, table in files.runs("second_ways").groupby("study"):
        yield _second(table, f"numbers of the answer that counts contradict, {study.removeprefix('claims_')}")


def _second(table: pd.DataFrame, text: str) -> Claim:
    """Return the claim that no number of a table differs too far from its second one."""
    far = int((table["difference"].abs() > LARGE).sum())
    return Claim(text, Exactly("none"), Exactly(f"{far} of {len(table)}" if far else "none"))


def _injured(table: pd.DataFrame, level: str) -> Mean:
    """Return a median of `DRAWS` draws; its error is 1 / (2 f √n), with the density f from the quartiles."""
    rows = table[(table["vehicle"] == TESTED) & (table["per"] == DISTANCE)].set_index("level")
    row = rows.loc[level]
    return Mean(row["median"], (row["high50"] - row["low50"]) / np.sqrt(DRAWS), DRAWS - 1)


def _ratio_to_human(table: pd.DataFrame) -> Mean:
    """Return the median of the ratio; its quartiles are half as far apart as its 80 % limits."""
    row = table[(table["reference"] == HUMAN) & (table["level"] == SERIOUS)].iloc[0]
    error = (row["ratio_high80"] - row["ratio_low80"]) / 2 / np.sqrt(DRAWS)
    return Mean(row["ratio"], error, DRAWS - 1)
