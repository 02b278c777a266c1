"""One crash rate for all cut-ins, with one interval.

The answer of a study is for cut-ins whose gap closes, behind a lead vehicle that keeps its speed. Here it is
multiplied by the factor of lead motion, and the crashes of cut-ins whose gap opens are added. Nobody knows
which law of lead motion belongs to the traffic in question, so each law is equally likely. Draws of the
answer, of the law of motion with its error, and of the rate of cut-ins are combined; no law of cut-ins is
needed.
"""

from collections.abc import Mapping

import numpy as np
import pandas as pd
import scipy
from scipy.interpolate import interp1d
from scipy.special import ndtri

from accelerated_evaluation.answer.consequences.counted_crashes import HUNDRED_CAR_MILES, KILOMETRES_PER_MILE
from accelerated_evaluation.answer.consequences.criterion import CONFIDENCE
from accelerated_evaluation.answer.consequences.lead_motion import FEWEST
from accelerated_evaluation.answer.consequences.moving_problem import NONE
from accelerated_evaluation.answer.consequences.rates import UNITS, Rate
from accelerated_evaluation.answer.consequences.total import SIZE, rate_values
from accelerated_evaluation.answer.ways.comparison import posterior_of
from accelerated_evaluation.answer.ways.posterior import SUMMARY, Posterior, summarise_bounds
from accelerated_evaluation.base.arrays import Array

CLOSING_CUT_IN = "closing cut-in"
KEEPS, CLOSING, OPENING, ALL = "closing, lead keeps its speed", "closing", "opening", "all"
NO_RECORDS = "records of opening cut-ins (used: closing ones with the other sign)"
NO_EXPOSURE = "distance and time of the records"
NO_MOTION = "lead motion: the vehicle cannot be simulated with it, or never crashes without it"
COLUMNS = ["vehicle", "part", "per", "mean", *SUMMARY[1:], "upper95", "share", "in_hundred_car", "missing"]

# Columns of the table that are quantiles of a rate, and their levels.
QUANTILES = {"low95": 0.025, "low80": 0.1, "low50": 0.25, "median": 0.5, "high50": 0.75, "high80": 0.9}
QUANTILES |= {"upper95": 0.95, "high95": 0.975}
VALUES = 1000  # number of equally likely values that represent a rate of the table


def opening_law(moved: float, error: float, limit: float) -> "scipy.stats.gamma":
    """Return the distribution of the crash probability of an opening cut-in, a frozen gamma distribution.

    It has the mean ``moved`` and the standard deviation ``error`` of the estimate (Fay and Feuer 1997,
    Statistics in Medicine 16, 791-801). If ``moved`` is NaN because too few crashes were simulated, it is
    exponential, with the upper 95 % ``limit``. Such a law enters upper ends only.
    """
    if moved > 0:
        return scipy.stats.gamma((moved / error) ** 2, scale=error**2 / moved)
    return scipy.stats.gamma(1.0, scale=limit / NONE)


def motion_values(motion: pd.DataFrame, generator: np.random.Generator) -> tuple[Array, Array]:
    """Return equally likely factors of the closing cut-ins, and crashes of opening ones per closing cut-in.

    ``motion`` has the rows of one vehicle and one law of lead motion in `motion_table`. The factor is
    log-normal. Both arrays have the shape (`SIZE`,).
    """
    rows = motion.set_index("gap")
    closing, opening = rows.loc["closing"], rows.loc["opening"]
    deviation = np.sqrt(np.log1p((closing["factor_error"] / closing["factor"]) ** 2))
    factors = closing["factor"] * np.exp(deviation * generator.standard_normal(SIZE) - deviation**2 / 2)
    law = opening_law(*opening[["moving", "standard_error", "high95"]].astype(float))
    # By inversion: with draws by rejection, the last digit of a parameter may change how many are rejected.
    return factors, opening["cut_ins"] / closing["cut_ins"] * law.ppf(generator.random(SIZE))


def all_cut_ins(
    vehicle: str,
    posterior: Posterior,
    motions: Mapping[str, pd.DataFrame],
    rates: Mapping[str, Rate],
    opening: int,
    generator: np.random.Generator,
) -> pd.DataFrame:
    """Tabulate the crash rate of all cut-ins of a vehicle by its parts.

    Parameters
    ----------
    vehicle
        Name of the vehicle.
    posterior
        Crash probability of a closing cut-in behind a lead vehicle that keeps its speed.
    motions
        Rows of the vehicle in `motion_table`, by the name of the law of lead motion. The laws are equally
        likely. Laws without a factor, because no crash was simulated with a constant speed, are left out.
    rates
        Posterior of the closing cut-ins per ``kilometre`` and ``hour``; empty if the exposure is unknown.
    opening
        Number of recorded opening cut-ins.
    generator
        Source of randomness.

    Returns
    -------
    pandas.DataFrame
        Rows by ``part`` and unit (``per``): closing cut-ins with a constant lead speed, with each law of
        motion, with all laws, opening ones, and all cut-ins. A rate per closing cut-in counts all crashes for
        each cut-in that closes, because these are the recorded ones. The columns are mean, median, intervals,
        the one-sided 95 % bound ``upper95``, the ``share`` of the mean of all cut-ins, the mean number of
        crashes in the distance of the 100-Car study, and what the records do not give (``missing``).

        If only a limit of the crashes of opening cut-ins is known with a law of motion, it enters upper ends
        only. The mean and the median of opening cut-ins are then NaN, and so are those of all cut-ins if
        there is no other law. If the laws of motion contradict each other so much that the median lies in the
        gap between them, where each number is as good as another, it is NaN.

    Examples
    --------
    >>> rows = {"gap": ["closing", "opening"], "cut_ins": [0.5, 0.5], "moving": [2e-6, 0.0]}
    >>> rows |= {"standard_error": [0.0, 0.0], "high95": [2e-6, 3e-9], "factor": [2.0, np.nan]}
    >>> motion = pd.DataFrame(rows | {"factor_error": [0.0, np.nan]})
    >>> posterior = Posterior(np.array([2e-6, 2e-6]), np.zeros(2, int))
    >>> table = all_cut_ins("car", posterior, {"NGSIM": motion}, {}, 100, np.random.default_rng(1))
    >>> float(table.set_index("part").loc["closing, NGSIM", "median"])
    4e-06
    """
    keeps = rate_values(posterior, 1.0, generator)
    found = {
        name: motion_values(motion, generator)
        for name, motion in motions.items()
        if (motion.loc[motion["gap"] == "closing", "factor"] > 0).any()
    }
    parts, missing = {KEEPS: keeps}, [] if found else [NO_MOTION]
    limited = [name for name in found if not motions[name].set_index("gap").loc["opening", "moving"] > 0]
    if found:
        chosen = generator.permutation(np.arange(SIZE) % len(found))
        factor, opens = (np.choose(chosen, [each[k] for each in found.values()]) for k in (0, 1))
        least = np.where(np.isin(np.array(list(found))[chosen], limited), 0.0, opens)
        parts |= {f"closing, {name}": keeps * each[0] for name, each in found.items()}
        parts |= {CLOSING: keeps * factor, OPENING: np.array([least, opens])}
        parts[ALL] = parts[CLOSING] + parts[OPENING]
        missing += [] if opening >= FEWEST else [NO_RECORDS]
    if limited:
        missing.append(f"opening cut-ins with {' and '.join(limited)} (a limit, only in upper ends)")
    missing += [] if rates else [NO_EXPOSURE]
    rows, levels = [], (np.arange(SIZE) + 0.5) / SIZE
    for per, rate in {CLOSING_CUT_IN: None, **rates}.items():
        cut_ins = np.ones(SIZE) if rate is None else generator.permutation(rate.law.ppf(levels))
        for part, (least, most) in parts.items():
            summary = summarise_bounds(least * cut_ins, most * cut_ins)
            row = {"vehicle": vehicle, "part": part, "per": per, "mean": summary.pop("probability")} | summary
            row["upper95"] = float(np.quantile(most * cut_ins, CONFIDENCE))
            row["share"] = least.mean() / parts[ALL][0].mean() if found else np.nan
            if limited and (part == OPENING or (part == ALL and len(limited) == len(found))):
                row |= dict.fromkeys(("mean", "median", "share"), np.nan)
            if per == "kilometre":
                row["in_hundred_car"] = row["mean"] * 1e6 * HUNDRED_CAR_MILES * KILOMETRES_PER_MILE
            rows.append(row | {"missing": "; ".join(missing)})
    return pd.DataFrame(rows, columns=COLUMNS)


def rates_table(
    draws: pd.DataFrame,
    motions: Mapping[str, pd.DataFrame],
    size: int,
    exposure: Mapping[str, float | None],
    opening: int,
    generator: np.random.Generator,
) -> pd.DataFrame:
    """Return the tables of `all_cut_ins` of all vehicles, one below the other.

    ``draws`` are those of the vehicles (`comparison.draws_table` with a column ``vehicle``), ``motions`` the
    tables of `motion_table` by the name of the law of lead motion, ``size`` is the number of recorded closing
    cut-ins, and ``exposure`` has the ``kilometres`` and ``hours`` in which they were recorded.
    """
    rates = {
        unit: Rate(size, length) for key, unit in UNITS.items() if (length := exposure.get(key)) is not None
    }
    tables = []
    for vehicle, rows in draws.groupby("vehicle", sort=False):
        is_sampled = "error" in rows and rows["error"].notna().any()
        posterior = posterior_of(rows if is_sampled else rows.drop(columns="error", errors="ignore"))
        own = {name: motion[motion["vehicle"] == vehicle] for name, motion in motions.items()}
        tables.append(all_cut_ins(str(vehicle), posterior, own, rates, opening, generator))
    return pd.concat(tables, ignore_index=True) if tables else pd.DataFrame(columns=COLUMNS)


def every_encounter(table: pd.DataFrame, vehicle: str) -> Posterior | None:
    """Return the crash probability of a vehicle in cut-ins of all kinds, per closing cut-in; None if unknown.

    ``table`` is that of `rates_table`. The equally likely values are interpolated between the quantiles of
    the table, linearly in the normal score of the level and in the logarithm of the probability.
    """
    is_own = (table["vehicle"] == vehicle) & (table["part"] == ALL) & (table["per"] == CLOSING_CUT_IN)
    knots = table.loc[is_own, list(QUANTILES)].to_numpy(float)
    if not (knots > 0).all() or not len(knots):
        return None
    logs = np.maximum.accumulate(np.log(knots[0]))
    curve = interp1d(ndtri(list(QUANTILES.values())), logs, fill_value="extrapolate")
    values = np.exp(curve(ndtri((np.arange(VALUES) + 0.5) / VALUES)))
    return Posterior(np.minimum(values, 1.0), np.zeros(VALUES, dtype=int))
