"""What the paper leaves open or what this project does differently, and how much it matters."""

from collections.abc import Mapping
from typing import Any

import pandas as pd

from accelerated_evaluation.publishing.published import table


@table("readings")
def readings_table(
    trace: pd.DataFrame,
    estimates: pd.DataFrame,
    exact: pd.DataFrame,
    sensitivity: pd.DataFrame,
    repeated_searches: pd.DataFrame,
    config: Mapping[str, Any],
) -> pd.DataFrame:
    """List what the paper says, what this project does, and the measured effect of the difference.

    Parameters
    ----------
    trace, estimates, exact, sensitivity, repeated_searches
        Tables of a study, as in `Study`.
    config
        The study's configuration.

    Returns
    -------
    pandas.DataFrame
        Columns ``place`` (where in the paper), ``paper``, ``here`` and ``effect``.
    """
    search, sampling = config["cross_entropy"], config["importance_sampling"]
    probability = exact.set_index("segment").loc["all", "probability"]
    ratios = sensitivity.set_index("choice")["probability"] / probability if probability else None

    def factor(choice: str) -> str:
        found = ratios.loc[[choice]] if ratios is not None else []
        return f"probability x{found.min():.2g} to x{found.max():.2g}" if len(found) else "nothing crashes"

    single = sensitivity.query("choice == 'model' and value == 'single'")["probability"].iloc[0]
    updates = trace.dropna(subset="threshold_ttc_s")
    longer = int((updates["simulations"] > search["sample_size"]).sum())
    most, least = (repeated_searches["crash_updates"].agg(end) for end in ("max", "min"))
    needed = repeated_searches.query("method == 'piecewise'").groupby("crash_updates")["needed"].mean()
    by_paper = estimates[estimates["converged"] & estimates["method"].isin(["piecewise", "single"])]
    fewest = by_paper["events"].min()
    rows = [
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
            factor("knot of TTC^-1"),
        ),
        (
            "section VI",
            "the f under which the single method estimates is not stated",
            "both methods estimate under the piecewise f, as the common estimate in figure 12 suggests",
            f"under the single f: probability x{single / probability:.3g}"
            if probability
            else "nothing crashes",
        ),
        (
            "section VI",
            "no largest closing speed",
            f"{config['models']['closing_speed_max']:g} m/s, as in the authors' code",
            factor("closing-speed cap [m/s]"),
        ),
        (
            "section V.C.1",
            "thresholds only as a figure",
            f"the {search['event_quantile']:g} quantile of a score",
            "numbers of iterations and simulations of the searches",
        ),
        (
            "section V.C.2",
            "N is adjusted for each piece with a large portion; no numbers",
            f"a portion from 0.1 needs {search['minimum_piece_events']} events, and all together "
            f"{search['minimum_events']}; at most {search['maximum_batches']} N",
            f"{longer:,} of {len(updates):,} iterations simulated more than N",
        ),
        (
            "section V.C.3",
            "a lower bound of the weight of a piece without events",
            f"{search['minimum_weight']:g}, also for pieces with a few events",
            "none that is visible",
        ),
        (
            "section V.C.4",
            "a piece without events keeps its tilt, or it is set to 0",
            "it keeps its tilt; the mean of a bounded piece stays 2 % of its width inside; the tilt of an "
            "unbounded tail is at least 0, but single exponentials have no such limit",
            "the weights of piecewise have a finite variance; see notebook 08 for single",
        ),
        (
            "section V.C.5",
            "knots move until an iteration has enough events; no step, no limit",
            f"steps of {search['truncation_shift']['inverse_range']:g} 1/m and "
            f"{search['truncation_shift']['inverse_ttc']:g} 1/s, as long as an iteration may draw",
            "see notebooks 05 and 08",
        ),
        (
            "appendix C",
            "the search ends when theta converges",
            f"it ends after {search['crash_iterations']} updates in a row with the crash itself",
            f"after {most} instead of {least} updates, piecewise needs x{needed[most] / needed[least]:.3g}",
        ),
        (
            "section VI.C",
            "converged if the relative half-width is at most beta",
            f"and at least {sampling['minimum_events']} crashes were seen",
            f"piecewise and single stopped with at least {fewest:,.0f} crashes"
            if len(by_paper)
            else "no replicate converged",
        ),
        (
            "section VI.C",
            "10 tests",
            f"{sampling['replicates']} replicates that share the f* of {search['seeds']} searches",
            "standard errors are those of means by search",
        ),
    ]
    return pd.DataFrame(rows, columns=["place", "paper", "here", "effect"])
