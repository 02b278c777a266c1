"""What the paper leaves open or what this project does differently, and how much it matters."""

import math
from collections.abc import Mapping
from typing import Any

import pandas as pd
from scipy.special import ndtri

from accelerated_evaluation.laws.paper.models import IndependentLaw
from accelerated_evaluation.publishing.published import table
from accelerated_evaluation.publishing.tables.display import readable
from accelerated_evaluation.publishing.tables.models import without_mixtures
from accelerated_evaluation.publishing.tables.searches import search_totals
from accelerated_evaluation.publishing.tables.spreads import LEVEL, Mean, Spread, exactly, pooled_probability

NORMAL = float(ndtri((1 + LEVEL) / 2))
CHOSEN = {"pareto": ("Pareto", "inverse_range"), "exponential": ("exponential", "inverse_ttc")}
QUANTILE = 0.95  # at which the segments are compared, where the last knot of TTC^-1 is by default
# Where in the paper; what it says; what is done here; and the effect in the study.
READINGS = (
    (
        "section II",
        "17 distribution templates, which are not named",
        "18 families: the 17 continuous ones that MATLAB's statistics toolbox fits, and Pareto with one "
        "parameter, which the toolbox has as a generalized Pareto distribution only",
        "none on later results",
    ),
    (
        "section III",
        "the knots are not printed",
        "knot of TTC^-1 at a quantile of the records, of R^-1 by profile likelihood",
        "knot of TTC^-1: probability x{knot}",
    ),
    (
        "section VI",
        "the f under which the single method estimates is not stated",
        "both methods estimate under the piecewise f, as the common estimate in figure 12 suggests",
        "under the single f: probability x{single}",
    ),
    (
        "section VI",
        "no largest closing speed",
        "{cap:g} m/s, as in the authors' code",
        "other caps: probability x{caps}",
    ),
    (
        "section V.C.1",
        "thresholds only as a figure",
        "the {search[event_quantile]:g} quantile of a score",
        "numbers of iterations and simulations of the searches",
    ),
    (
        "section V.C.2",
        "N is adjusted for each piece with a large portion; no numbers",
        "a portion from 0.1 needs {search[minimum_piece_events]} events, and all together "
        "{search[minimum_events]}; at most {search[maximum_batches]} N",
        "{longer} of {updates} iterations simulated more than N",
    ),
    (
        "section V.C.3",
        "a lower bound of the weight of a piece without events",
        "{search[minimum_weight]:g}, also for pieces with a few events",
        "none that is visible",
    ),
    (
        "section V.C.4",
        "a piece without events keeps its tilt, or it is set to 0",
        "it keeps its tilt; the mean of a bounded piece stays 2 % of its width inside; the tilt of an "
        "unbounded tail is at least 0, but single exponentials have no such limit",
        "the tails of piecewise give the weights a finite variance; see chapter 9 for single",
    ),
    (
        "section V.C.5",
        "knots move until an iteration has enough events; no step, no limit",
        "steps of {search[truncation_shift][inverse_range]:g} 1/m and "
        "{search[truncation_shift][inverse_ttc]:g} 1/s, as long as an iteration may draw",
        "see chapters 7 and 9",
    ),
    (
        "appendix C",
        "the search ends when theta converges",
        "it ends after {search[crash_iterations]} updates in a row with the crash itself",
        "after {most} instead of {least} updates, piecewise needs x{needed} simulations",
    ),
    (
        "section VI.C",
        "converged if the relative half-width is at most beta",
        "and at least {sampling[minimum_events]} crashes were seen",
        "piecewise and single stopped with at least {fewest} crashes",
    ),
    (
        "section VI.C",
        "10 tests",
        "{sampling[replicates]} replicates that share the f* of {search[seeds]} searches",
        "the searches differ little, see table needed",
    ),
)


def heuristic_acts(trace: pd.DataFrame) -> bool:
    """Return whether the heuristic moved a knot in any search of the first segment."""
    searches = trace[trace["method"] == "heuristic"]
    knots = searches[searches["segment"] == searches["segment"].iloc[0]] if len(searches) else searches
    knots = knots.filter(regex=r"^inverse_(range|ttc)_from_")
    return bool((knots.max() > knots.min()).any())


def of_records(pairs: pd.DataFrame, candidates: pd.DataFrame, similarity: pd.DataFrame) -> dict[str, Spread]:
    """Return the numbers for the statements about the recorded lane changes."""
    strongest = pairs.loc[pairs["tau"].abs().idxmax()]
    excluded = int(((pairs["ci_low"] > 0) | (pairs["ci_high"] < 0)).sum())
    where = f"{strongest['pair']}, {strongest['segment']} m/s; {excluded} of {len(pairs)} intervals exclude 0"
    found = {"independent": _interval(strongest, "tau", where.replace("_", " "))}
    common = candidates.assign(rank=without_mixtures(candidates)).dropna(subset="rank")
    for key, (family, variable) in CHOSEN.items():
        rows = common[(common["variable"] == variable) & (common["family"] == family)]
        ranks = rows.set_index("segment")["rank"].astype(int)
        text = ", ".join(f"{rank} ({segment})" for segment, rank in ranks.items())
        best = ranks["all"] if "all" in ranks else ranks.min()
        found[key] = exactly(float(best), f"none; ranks among {common['family'].nunique()} families: {text}")
    row = similarity.set_index("quantile").loc[QUANTILE]
    where = (
        f"{row['largest']:.3f} 1/s at {row['largest_in']} m/s, {row['smallest']:.3f} at {row['smallest_in']}"
    )
    return found | {"similar": _interval(row, "ratio", where)}


def _interval(row: pd.Series, value: str, where: str) -> Spread:
    return Spread(row[value], row["ci_low"], row["ci_high"], f"95 % interval, block jackknife; {where}")


def same_tail(two: IndependentLaw, three: IndependentLaw) -> Spread:
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


def settled(repeated: pd.DataFrame) -> dict[str, Spread]:
    """Return the change of the main tilts in the longest searches, from update to update."""
    most = repeated["crash_updates"].max()
    rows = repeated[(repeated["crash_updates"] == most) & (repeated["method"] == "piecewise")]
    columns = {"settled_ttc": "change_inverse_ttc", "settled_range": "change_inverse_range"}
    what = f"{len(rows)} searches with {most} updates"
    return {key: Mean.of(rows[column]).interval(what) for key, column in columns.items()}


def same_estimate(course: pd.DataFrame, alpha: float) -> Spread:
    """Return the ratio of the pooled estimates, single to piecewise."""
    pooled = [pooled_probability(course, method, alpha) for method in ("single", "piecewise")]
    if not all(estimate.value > 0 for estimate in pooled):
        return exactly(math.nan, "none, no crash was seen")
    reach = -float(ndtri(alpha / 2))
    means = [Mean(of.value, (of.high - of.low) / (2 * reach), math.inf) for of in pooled]
    return means[0].over(means[1]).interval("all simulations")


def faster(
    variation: pd.DataFrame,
    trace: pd.DataFrame,
    repeated: pd.DataFrame,
    crude: float,
    alpha: float,
    beta: float,
) -> dict[str, Spread]:
    """Return how much piecewise saves compared with single, and with the simulations of crude Monte Carlo.

    The numbers of simulations to convergence are those of the exact variances, one for each search. An
    estimate has converged at a relative half-width of at most beta of its interval of level 1 - alpha.
    """
    reach, totals = -float(ndtri(alpha / 2)) / beta, search_totals(trace)
    sizes, together = {}, {}
    for method in ("piecewise", "single"):
        found = variation.query("method == @method and segment == 'all'")
        needed = (reach * found["variation_trimmed"].to_numpy()) ** 2
        sizes[method] = Mean.of(needed)
        together[method] = Mean.of(needed + totals[method].to_numpy())
    what = _by_exact_variances(len(totals["single"]))
    saved = sizes["piecewise"].over(sizes["single"])
    saving = saved._replace(value=1 - saved.value).interval(what)
    ratio = Mean(crude, 0.0, math.inf).over(sizes["piecewise"]).interval(what)
    return {
        "ratio_single": sizes["single"].over(sizes["piecewise"]).interval(what),
        "ratio_crude": ratio,
        "saving": saving,
        "faster_search": _with_search(repeated),
        "faster_all": together["single"].over(together["piecewise"]).interval(what),
        "half": saving,
        "faster": ratio,
        "orders": Spread(*(math.log10(size) if size > 0 else math.nan for size in ratio[:3]), ratio.of),
    }


def _with_search(repeated: pd.DataFrame) -> Spread:
    """Return the ratio of simulations, single to piecewise, with the searches, in the first segment."""
    rows = _shortest(repeated)
    sums = (rows["simulations"] + rows["needed"]).groupby(rows["method"])
    needed = {name: Mean.of(found) for name, found in sums}
    return needed["single"].over(needed["piecewise"]).interval(_by_exact_variances(rows["seed"].nunique()))


def improves(repeated: pd.DataFrame, method: str) -> Spread:
    """Return the ratio of simulations to convergence, piecewise to a method, by the exact variance."""
    rows = _shortest(repeated)
    needed = {name: Mean.of(found["needed"]) for name, found in rows.groupby("method")}
    if method not in needed:
        return exactly(math.nan, "none, the study does not have the method")
    ratio = needed["piecewise"].over(needed[method])
    return ratio.interval(_by_exact_variances(rows["seed"].nunique()))


def _shortest(repeated: pd.DataFrame) -> pd.DataFrame:
    """Return the searches with the fewest updates, as in the study."""
    return repeated[repeated["crash_updates"] == repeated["crash_updates"].min()]


def _by_exact_variances(searches: int) -> str:
    return f"exact variances of {searches} search{'es' * (searches != 1)} each"


@table("readings")
def readings_table(
    trace: pd.DataFrame,
    estimates: pd.DataFrame,
    exact: pd.DataFrame,
    sensitivity: pd.DataFrame,
    repeated_searches: pd.DataFrame,
    search: Mapping[str, Any],
    sampling: Mapping[str, Any],
    cap: float,
) -> pd.DataFrame:
    """List what the paper says, what this project does, and the measured effect of the difference."""
    settings = {"search": search, "sampling": sampling, "cap": cap}
    values = _of_searches(trace, repeated_searches, search["sample_size"])
    values |= _of_probability(sensitivity, exact) | {"fewest": _fewest_crashes(estimates)}
    values = settings | {name: readable(value) for name, value in values.items()}
    rows = [[text.format(**values) for text in reading] for reading in READINGS]
    return pd.DataFrame(rows, columns=["place", "paper", "here", "effect"])


def _of_searches(trace: pd.DataFrame, repeated: pd.DataFrame, sample_size: int) -> dict[str, float]:
    updates = trace.dropna(subset="threshold_ttc_s")
    needed = repeated.query("method == 'piecewise'").groupby("crash_updates")["needed"].mean()
    least, most = needed.index.min(), needed.index.max()
    return {
        "updates": len(updates),
        "longer": int((updates["simulations"] > sample_size).sum()),
        "least": least,
        "most": most,
        "needed": needed[most] / needed[least],
    }


def _of_probability(sensitivity: pd.DataFrame, exact: pd.DataFrame) -> dict[str, float | str]:
    """Return the probabilities with other choices, divided by the exact one; NaN if nothing crashes."""
    probability = exact.set_index("segment").loc["all", "probability"] or math.nan
    ratios = sensitivity.set_index(["choice", "value"])["probability"] / probability
    found = {"single": ratios["model", "single"]}
    for name, choice in (("knot", "knot of TTC^-1"), ("caps", "closing-speed cap [m/s]")):
        of_choice = ratios[ratios.index.get_level_values("choice") == choice]
        found[name] = " to x".join(str(readable(end, 2)) for end in (of_choice.min(), of_choice.max()))
    return found


def _fewest_crashes(estimates: pd.DataFrame) -> float:
    by_paper = estimates["converged"] & estimates["method"].isin(["piecewise", "single"])
    return estimates.loc[by_paper, "events"].min()
