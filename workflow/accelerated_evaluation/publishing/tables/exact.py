"""Tables of exact probabilities and of the simulations that each f* needs, of severity and of injuries."""

import math

import numpy as np
import pandas as pd
from scipy.special import ndtri
from scipy.stats import binomtest

from accelerated_evaluation.answer.consequences.injuries.tables import PER_ENCOUNTER
from accelerated_evaluation.methods.importance_sampling import crude_simulations
from accelerated_evaluation.publishing.published import result_table, table
from accelerated_evaluation.publishing.tables.display import readable
from accelerated_evaluation.publishing.tables.laws import DIGITS, with_limits
from accelerated_evaluation.publishing.tables.paper_claims import PAPER_SIMULATIONS

DIGEST = ("event", "probability", "to_crash", "per_million_km")
EVENTS = {
    "crash": "crash",
    "impact_speed": "impact speed > {:g} m/s",
    "min_range": "smallest range < {:g} m",
    "min_ttc": "smallest TTC < {:g} s",
}
SURE = 4  # half-width, in standard errors, of the range in which the true probability may lie
CONTRADICTED = 1e-4  # p-value below which simulations contradict all values in this range
HEAVY = 10  # factor of the rarest crashes in a coefficient of variation that simulations do not show
DISTANCE = "million kilometres"


@table("needed", digits=3)
def needed_simulations(
    variation: pd.DataFrame, exact: pd.DataFrame, alpha: float, beta: float
) -> pd.DataFrame:
    """Tabulate the number of simulations to convergence, computed from the exact variance under each f*.

    Convergence is a relative half-width beta of the normal interval with level 1 - alpha; crude Monte Carlo
    is from ``exact``. For each scope and method, ``infinite`` is the number of f* that fall more than twice
    as fast as f in the tail, so that the variance is infinite; ``decay`` the largest ratio of these rates;
    ``hidden`` the number of f* whose variance depends on the rarest crashes; ``variation`` the mean
    coefficient of variation of a weight without these crashes; and ``simulations`` the mean over the
    ``searches``, with its range.
    """
    rows = []
    for (scope, method), found in variation.groupby(["segment", "method"], sort=False):
        sizes = (ndtri(alpha / 2) * found["variation_trimmed"] / beta) ** 2
        hidden = np.isinf(found["variation"]) | (found["variation"] > HEAVY * found["variation_trimmed"])
        rows.append(
            {
                "scope": scope,
                "method": method,
                "searches": len(found),
                "infinite": int((found["decay"] > 2).sum()),
                "decay": found["decay"].max().round(6),
                "hidden": int(hidden.sum()),
                "variation": found["variation_trimmed"].mean(),
                "simulations": sizes.mean(),
                "simulations_low": sizes.min(),
                "simulations_high": sizes.max(),
            }
        )
    for scope, probability in exact.set_index("segment")["probability"].items():
        if probability > 0:
            variation, size = math.sqrt(1 / probability - 1), crude_simulations(probability, alpha, beta)
            row = {"scope": scope, "method": "crude", "searches": 0, "infinite": 0, "hidden": 0}
            rows.append(row | {"variation": variation, "simulations": size})
    needed = pd.DataFrame(rows)
    paper = needed["method"].map(PAPER_SIMULATIONS).where(needed["scope"] == "all")
    return needed.assign(paper_simulations=paper)


def severity_digest(severity: pd.DataFrame) -> pd.DataFrame:
    """Return the rows over all segments of ``severity.csv``, with a description of each event."""
    rows = severity[severity["segment"] == "all"]
    events = [EVENTS[row.quantity].format(row.threshold) for row in rows.itertuples()]
    return rows[["probability", "to_crash", "per_million_km"]].assign(event=events)[list(DIGEST)]


def contradictions(truth: pd.Series, crude: pd.DataFrame) -> str:
    """Test whether the crashes of crude Monte Carlo contradict the exact probability, by a binomial test.

    The hypothesis is the probability, within `SURE` standard errors of the exact one, that fits the number of
    crashes best. The result is a warning if the p-value is below `CONTRADICTED`, and otherwise empty.
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


def share_of_one_run(uncertainty: pd.DataFrame, alpha: float, beta: float) -> float:
    """Return the share of sampling in the variance, if a single run has just converged.

    Its relative standard error is then beta / z. The other sources are those in ``uncertainty.csv``.
    """
    budget = uncertainty.set_index("source").loc[["data", "choice of model"]]
    others = ((budget["standard_deviation"] / budget["probability"]) ** 2).sum()
    sampling = (beta / ndtri(alpha / 2)) ** 2
    return float(sampling / (sampling + others))


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


def best_known(injuries: pd.DataFrame) -> pd.DataFrame:
    """Return the injuries per million kilometres, or per cut-in if the distance is not known."""
    per = DISTANCE if (injuries["per"] == DISTANCE).any() else PER_ENCOUNTER
    return injuries[injuries["per"] == per]


# The injured drivers of all vehicles.
injuries_table = result_table("injuries", digits=DIGITS)


def balance_digest(risk_balance: pd.DataFrame) -> pd.DataFrame:
    """Return the ratios of injured drivers by other vehicle and level of injury, with 80 % intervals."""
    limits = (risk_balance[f"ratio_{end}80"] for end in ("low", "high"))
    ratios = risk_balance.assign(ratio=with_limits(risk_balance["ratio"], *limits))
    wide = ratios.pivot_table("ratio", "reference", "level", aggfunc="first")
    order = [risk_balance[name].unique() for name in ("reference", "level")]
    return wide.loc[order[0], order[1]].rename_axis(columns=None).reset_index()


# The ratios of injured drivers to those of the other vehicles.
risk_balance_table = result_table("risk_balance", digits=DIGITS, digest=balance_digest)

# The sources of the uncertainty of the injured drivers.
injury_budget_table = result_table("injury_budget", digits=3)


def curves_digest(injury_curves: pd.DataFrame) -> pd.DataFrame:
    """Return four columns of the table of risk curves: level, impact, source and curve."""
    return injury_curves[["level", "impact", "source", "curve"]]


# The published curves.
injury_curves_table = result_table("injury_curves", digest=curves_digest)


def injuries_in_words(injuries: pd.DataFrame, level: str) -> str:
    """Return the median number of injured drivers with its 80 % interval and unit, or "not known"."""
    rows = best_known(injuries)
    found = rows[(rows["vehicle"] == "under test") & (rows["level"] == level)]
    if found.empty:
        return "not known"
    row = found.iloc[0]
    low, median, high = (readable(row[name], DIGITS) for name in ("low80", "median", "high80"))
    return f"{median} ({low} to {high}) per {row['per']}"
