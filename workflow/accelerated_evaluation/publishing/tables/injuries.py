"""Tables, beyond the paper, of the injuries of both drivers, and of the curves of the risk of injury."""

import pandas as pd

from accelerated_evaluation.publishing.published import result_table
from accelerated_evaluation.publishing.tables.display import readable
from accelerated_evaluation.publishing.tables.laws import DIGITS, interval_column

DISTANCE = "million kilometres"
CUT_IN = "cut-in"


def best_known(injuries: pd.DataFrame) -> pd.DataFrame:
    """Return the injuries per million kilometres, or per cut-in if the distance is not known."""
    per = DISTANCE if (injuries["per"] == DISTANCE).any() else CUT_IN
    return injuries[injuries["per"] == per]


def injuries_digest(injuries: pd.DataFrame) -> pd.DataFrame:
    """Return a short table of injured drivers, with a row for each vehicle and level of injury.

    The columns are the median per million kilometres (or per cut-in) with its 80 % interval, the number per
    crash, and the share in impacts at low speed.
    """
    rows = best_known(injuries).reset_index(drop=True)
    per = rows["per"].iloc[0] if len(rows) else CUT_IN
    per_cut_in = injuries[injuries["per"] == CUT_IN].set_index(["vehicle", "level"])["mean"]
    keys = pd.MultiIndex.from_frame(rows[["vehicle", "level"]])
    return pd.DataFrame(
        {
            "vehicle": rows["vehicle"],
            "injury": rows["level"],
            "mean per cut-in": per_cut_in.reindex(keys).to_numpy(),
            f"median per {per}": rows["median"],
            "80 %": interval_column(rows["low80"], rows["high80"]),
            "per crash": rows["per_crash"],
            "gentle": rows["gentle"],
        }
    )


# The injured drivers of all vehicles.
injuries_table = result_table("injuries", digits=DIGITS, digest=injuries_digest)


def balance_digest(risk_balance: pd.DataFrame) -> pd.DataFrame:
    """Return a short table of the ratios of injured drivers, vehicle under test by other vehicle.

    The limits of the 80 % interval of a ratio are in one column.
    """
    interval = interval_column(risk_balance["ratio_low80"], risk_balance["ratio_high80"])
    shown = risk_balance[["reference", "level", "ratio"]].assign(**{"80 %": interval})
    return shown.assign(fewer_injured=risk_balance["fewer_injured"])


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
