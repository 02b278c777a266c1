"""Our numbers for the statements of the paper in words; see `paper_claims.STATEMENTS`."""

import math
from typing import NamedTuple

import numpy as np
import pandas as pd
from scipy.special import ndtri

from accelerated_evaluation.laws.paper.independent import IndependentLaw
from accelerated_evaluation.publishing.tables.searches import search_totals
from accelerated_evaluation.publishing.tables.spreads import (
    LEVEL,
    Mean,
    Spread,
    crude_sample_size,
    exactly,
    pooled_probability,
)

NORMAL = float(ndtri((1 + LEVEL) / 2))
CHOSEN = {"pareto": ("Pareto", "inverse_range"), "exponential": ("exponential", "inverse_ttc")}
QUANTILE = 0.95  # at which the segments are compared, where the last knot of TTC^-1 is by default


class Evidence(NamedTuple):
    """The results of a study by which the statements are judged, as in `Study`."""

    dependence: pd.DataFrame
    candidates: pd.DataFrame
    similarity: pd.DataFrame
    two_pieces: IndependentLaw
    three_pieces: IndependentLaw
    repeated_searches: pd.DataFrame
    trace: pd.DataFrame
    course: pd.DataFrame
    exact: pd.DataFrame
    variation: pd.DataFrame


def statements(evidence: Evidence, alpha: float, beta: float) -> dict[str, Spread]:
    """Return our number for each statement of the paper, by its key.

    An estimate has converged at a relative half-width of at most beta of its interval of level 1 - alpha.
    """
    return (
        _records(evidence)
        | {"same_tail": _same_tail(evidence.two_pieces, evidence.three_pieces)}
        | _settled(evidence.repeated_searches)
        | {"same_estimate": _same_estimate(evidence.course, alpha)}
        | _faster(evidence, alpha, beta)
        | {"heuristic": _heuristic(evidence.repeated_searches)}
    )


def _records(evidence: Evidence) -> dict[str, Spread]:
    """Return the numbers for the statements about the recorded lane changes."""
    pairs = evidence.dependence
    strongest = pairs.loc[pairs["tau"].abs().idxmax()]
    excluded = int(((pairs["ci_low"] > 0) | (pairs["ci_high"] < 0)).sum())
    where = f"{strongest['pair']}, {strongest['segment']} m/s; {excluded} of {len(pairs)} intervals exclude 0"
    found = {"independent": _interval(strongest, "tau", where.replace("_", " "))}
    common = evidence.candidates[~evidence.candidates["family"].str.startswith("piecewise")]
    for key, (family, variable) in CHOSEN.items():
        rows = common[common["variable"] == variable]
        ranks = rows.assign(rank=rows.groupby("segment")["aic"].rank())
        ranks = ranks[ranks["family"] == family].set_index("segment")["rank"].dropna().astype(int)
        text = ", ".join(f"{rank} ({segment})" for segment, rank in ranks.items())
        best = ranks["all"] if "all" in ranks else ranks.min()
        found[key] = exactly(float(best), f"none; ranks among {common['family'].nunique()} families: {text}")
    row = evidence.similarity.set_index("quantile").loc[QUANTILE]
    where = (
        f"{row['largest']:.3f} 1/s at {row['largest_in']} m/s, {row['smallest']:.3f} at {row['smallest_in']}"
    )
    return found | {"similar": _interval(row, "ratio", where)}


def _interval(row: pd.Series, value: str, where: str) -> Spread:
    return Spread(row[value], row["ci_low"], row["ci_high"], f"95 % interval, block jackknife; {where}")


def _same_tail(two: IndependentLaw, three: IndependentLaw) -> Spread:
    """Return the ratio of the rates of the last pieces of R^-1, of three pieces to two.

    If both tails are parts of one exponential, the rate of the longer tail is efficient. The variance of the
    difference of the logarithms is then the difference of their variances, 1 / n each (Hausman 1978).
    """
    lasts = [(law.inverse_range.components[-1], law.inverse_range.weights[-1]) for law in (two, three)]
    rates = [1 / (piece.mean() - piece.lower) for piece, _ in lasts]
    events = [share * sum(two.counts.values()) for _, share in lasts]
    ratio, error = rates[1] / rates[0], math.sqrt(abs(1 / events[1] - 1 / events[0])) or math.nan
    low, high = (ratio * math.exp(sign * NORMAL * error) for sign in (-1, 1))
    of = f"95 % interval, from {events[1]:,.0f} of the {events[0]:,.0f} records in the longer tail"
    return Spread(ratio, low, high, of)


def _settled(repeated: pd.DataFrame) -> dict[str, Spread]:
    most = repeated["crash_updates"].max()
    rows = repeated[(repeated["crash_updates"] == most) & (repeated["method"] == "piecewise")]
    columns = {"settled_ttc": "change_inverse_ttc", "settled_range": "change_inverse_range"}
    what = f"{len(rows)} searches with {most} updates"
    return {key: Mean.of(rows[column]).interval(what) for key, column in columns.items()}


def _same_estimate(course: pd.DataFrame, alpha: float) -> Spread:
    pooled = [pooled_probability(course, method, alpha) for method in ("single", "piecewise")]
    if not all(estimate.value > 0 for estimate in pooled):
        return exactly(math.nan, "none, no crash was seen")
    reach = -float(ndtri(alpha / 2))
    means = [Mean(of.value, (of.high - of.low) / (2 * reach), math.inf) for of in pooled]
    return means[0].over(means[1]).interval("all simulations")


def _faster(evidence: Evidence, alpha: float, beta: float) -> dict[str, Spread]:
    """Return how much piecewise saves compared with single, and with crude Monte Carlo.

    The numbers of simulations to convergence are those of the exact variances, one for each search.
    """
    reach, totals, sizes, together = -float(ndtri(alpha / 2)) / beta, search_totals(evidence.trace), {}, {}
    for method in ("piecewise", "single"):
        found = evidence.variation.query("method == @method and segment == 'all'")
        needed = (reach * found["variation_trimmed"].to_numpy()) ** 2
        sizes[method] = Mean.of(needed)
        together[method] = Mean.of(needed + totals[method].to_numpy())
    crude = Mean(crude_sample_size(evidence.exact, alpha, beta).value, 0.0, math.inf)
    what = f"exact variances of {sizes['single'].freedom + 1} searches each"
    saved = sizes["piecewise"].over(sizes["single"])
    ratio = crude.over(sizes["piecewise"]).interval(what)
    return {
        "faster_search": together["single"].over(together["piecewise"]).interval(what),
        "half": saved._replace(value=1 - saved.value).interval(what),
        "faster": ratio,
        "orders": Spread(*(float(np.log10(number)) for number in ratio[:3]), ratio.of),
    }


def _heuristic(repeated: pd.DataFrame) -> Spread:
    """Return the ratio of simulations to convergence, piecewise to heuristic, by the exact variance."""
    rows = repeated[repeated["crash_updates"] == repeated["crash_updates"].min()]
    needed = {name: Mean.of(found["needed"]) for name, found in rows.groupby("method")}
    ratio = needed["piecewise"].over(needed["heuristic"])
    return ratio.interval(f"exact variances of {rows['seed'].nunique()} searches each")
