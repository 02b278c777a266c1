"""Tables of exact probabilities: numbers of simulations that each f* needs, and severity of crashes."""

import math

import numpy as np
import pandas as pd
from scipy.special import ndtri
from scipy.stats import binomtest

from accelerated_evaluation.methods.importance_sampling import crude_simulations
from accelerated_evaluation.publishing.published import result_table
from accelerated_evaluation.publishing.tables.paper_numbers import PAPER_SIMULATIONS

DIGEST = ("event", "probability", "to_crash", "per_million_km")
EVENTS = {
    "crash": "crash",
    "impact_speed": "impact speed > {:g} m/s",
    "min_range": "smallest range < {:g} m",
    "min_ttc": "smallest TTC < {:g} s",
}
SURE = 4  # half-width, in standard errors, of the range in which the true probability may lie
CONTRADICTED = 1e-4  # p-value below which simulations contradict all values in this range
HEAVY = 10  # an f* is heavy-tailed if the rarest crashes increase the coefficient of variation by this factor


def needed_simulations(
    variation: pd.DataFrame, probability: float, alpha: float, beta: float
) -> pd.DataFrame:
    """Tabulate the number of simulations to convergence, computed from the exact variance under each f*.

    Parameters
    ----------
    variation
        ``variation.csv`` of a study.
    probability
        The exact crash probability, for crude Monte Carlo.
    alpha, beta
        Convergence is a relative half-width beta of the normal interval with level 1 - alpha.

    Returns
    -------
    pandas.DataFrame
        A row for each method: ``searches``, their number; ``heavy_tailed``, the number of f* whose variance
        depends on the rarest crashes; ``variation``, the mean coefficient of variation of a weight without
        these crashes; ``simulations``, the mean number of simulations over the searches, with its range
        ``simulations_low`` to ``simulations_high``; ``paper_simulations``, the paper's number (table I).
    """
    everywhere = variation[variation["segment"] == "all"]
    rows = []
    for method, found in everywhere.groupby("method", sort=False):
        sizes = (ndtri(alpha / 2) * found["variation_trimmed"] / beta) ** 2
        heavy = int((found["variation"] > HEAVY * found["variation_trimmed"]).sum())
        sample = found["variation_trimmed"].mean(), sizes.mean(), sizes.min(), sizes.max()
        rows.append((method, len(found), heavy, *sample))
    if probability > 0:
        crude = crude_simulations(probability, alpha, beta)
        rows.append(("crude", 0, 0, math.sqrt(1 / probability - 1), crude, crude, crude))
    columns = [
        "method",
        "searches",
        "heavy_tailed",
        "variation",
        "simulations",
        "simulations_low",
        "simulations_high",
    ]
    table = pd.DataFrame(rows, columns=columns)
    return table.assign(paper_simulations=table["method"].map(PAPER_SIMULATIONS))


def severity_digest(severity: pd.DataFrame) -> pd.DataFrame:
    """Return the rows over all segments of ``severity.csv``, with a description of each event.

    Returns
    -------
    pandas.DataFrame
        Columns ``event``, ``probability``, ``to_crash`` (ratio to the crash probability) and
        ``per_million_km``.
    """
    rows = severity[severity["segment"] == "all"]
    events = [EVENTS[row.quantity].format(row.threshold) for row in rows.itertuples()]
    return rows[["probability", "to_crash", "per_million_km"]].assign(event=events)[list(DIGEST)]


def contradictions(truth: pd.Series, crude: pd.DataFrame) -> str:
    """Test whether the crashes of crude Monte Carlo contradict the exact probability, by a binomial test.

    The hypothesis is the probability, within `SURE` standard errors of the exact one, that fits the number of
    crashes best.

    Parameters
    ----------
    truth
        ``probability`` and ``standard_error`` over all segments.
    crude
        ``crude.csv`` of a study.

    Returns
    -------
    str
        A warning if the p-value is below `CONTRADICTED`; empty otherwise.
    """
    found = crude.set_index("segment").loc["all"]
    crashes, simulations = int(found["crashes"]), int(found["simulations"])
    reach = SURE * truth["standard_error"]
    nearest = np.clip(crashes / simulations, truth["probability"] - reach, truth["probability"] + reach)
    p = binomtest(crashes, simulations, float(np.clip(nearest, 0, 1))).pvalue
    if p >= CONTRADICTED:
        return ""
    return (
        f"Crude Monte Carlo contradicts the crash map: {crashes:,} crashes in {simulations:,} simulations, "
        f"where {truth['probability'] * simulations:,.1f} are expected (p = {p:.1g}). Do not take the value "
        "of the map as exact; refine the map (crash_map.grid)."
    )


# The exact crash probabilities.
exact_table = result_table("exact", digits=4)

# The exact crash probabilities by resolution of the map.
convergence_table = result_table("convergence", digits=4)

# The results of crude Monte Carlo.
crude_table = result_table("crude", digits=3)

# The crash probability by choice.
sensitivity_table = result_table("sensitivity", digits=4)

# The budget of the uncertainty.
uncertainty_table = result_table("uncertainty", digits=3)

# The probabilities of crashes and near misses; readers are shown the `severity_digest`.
severity_table = result_table("severity", digits=3, digest=severity_digest)
