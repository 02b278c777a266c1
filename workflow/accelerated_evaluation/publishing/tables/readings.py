"""What the paper leaves open or what this project does differently, and how much it matters."""

import math
from collections.abc import Mapping
from typing import Any

import pandas as pd

from accelerated_evaluation.publishing.published import table
from accelerated_evaluation.publishing.tables.formats import readable

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
        "the tails of piecewise give the weights a finite variance; see notebook 08 for single",
    ),
    (
        "section V.C.5",
        "knots move until an iteration has enough events; no step, no limit",
        "steps of {search[truncation_shift][inverse_range]:g} 1/m and "
        "{search[truncation_shift][inverse_ttc]:g} 1/s, as long as an iteration may draw",
        "see notebooks 05 and 08",
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


@table("readings")
def readings_table(
    trace: pd.DataFrame,
    estimates: pd.DataFrame,
    exact: pd.DataFrame,
    sensitivity: pd.DataFrame,
    repeated_searches: pd.DataFrame,
    config: Mapping[str, Any],
) -> pd.DataFrame:
    """List what the paper says, what this project does, and the measured effect of the difference."""
    settings = {
        "search": config["cross_entropy"],
        "sampling": config["importance_sampling"],
        "cap": config["models"]["closing_speed_max"],
    }
    values = _of_searches(trace, repeated_searches, settings["search"]["sample_size"])
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
    """Return ratios of probabilities with other choices to the exact one; NaN if nothing crashes."""
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
