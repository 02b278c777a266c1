"""Is the traffic of the simulated motorway like recorded traffic? Its statistics next to those of NGSIM.

The figures of NGSIM were measured once, on pieces of it that are not part of this project: 33 snippets of
US-101 (1,076 vehicles, 88.6 km) with 62 cut-ins, and pairs of following cars. NGSIM was recorded by the US
Department of Transportation.
"""

import argparse
from dataclasses import dataclass

import numpy as np
import pandas as pd
from accelerated_evaluation.base.files import write_csv
from traffic import FASTER, RATE, WINDOW, Trajectories, run_command

FAR = 100.0  # [m], gap up to which a car follows another one
LEVELS = (0.1, 0.5, 0.9)  # of the time gaps


@dataclass(frozen=True)
class Reference:
    """A statistic of NGSIM: its value or values, and the limits within which the motorway should be."""

    statistic: str
    ngsim: str
    limits: tuple[float, float]
    reason: str


WITHIN = "1.5 times the figures of NGSIM"
BINOMIAL = "95 % limits of a share of 22 cut-ins"
REFERENCES = {
    "drops_above_3": Reference(
        "5-s windows that lose more than 3 m/s", "0.06 to 0.09", (0.04, 0.135), WITHIN
    ),
    "drops_above_5": Reference(
        "5-s windows that lose more than 5 m/s", "0.015 to 0.021", (0.01, 0.032), WITHIN
    ),
    "gap_0.1": Reference("time gap [s], 10 % quantile", "0.71", (0.47, 1.07), WITHIN),
    "gap_0.5": Reference("time gap [s], median", "1.42", (0.95, 2.13), WITHIN),
    "gap_0.9": Reference("time gap [s], 90 % quantile", "2.90", (1.93, 4.35), WITHIN),
    "cut_ins_per_km": Reference(
        "cut-ins in front of a vehicle, per km",
        "62 in 88.6 km",
        (0.53, 0.90),
        "95 % limits of a Poisson count",
    ),
    "lost_above_1": Reference(
        "cut-ins whose lead loses more than 1 m/s in 5 s", "0.32", (0.14, 0.55), BINOMIAL
    ),
    "lost_above_2": Reference(
        "cut-ins whose lead loses more than 2 m/s in 5 s", "0.09", (0.01, 0.29), BINOMIAL
    ),
}


def traffic_row(found: Trajectories, cut_ins: pd.DataFrame) -> dict[str, float]:
    """Return the statistics of some traffic.

    Returns
    -------
    dict
        ``kilometres`` of all vehicles, ``collisions``, ``cut_ins``; ``lane_changes_per_km`` and
        ``cut_ins_per_km`` of all vehicles, whatever their range; shares of 5-s windows above 8 m/s in which a
        vehicle lost more than 3 and 5 m/s; quantiles of the time gap [s] of vehicles above 8 m/s; and of the
        cars that cut in and stayed for 5 s the share that lost more than 1 and 2 m/s.
    """
    kilometres = found.speed.sum() / RATE / 1000
    steps = round(WINDOW * RATE)
    windows = np.flatnonzero((found.frame % steps == 0) & (found.speed > FASTER))
    windows = windows[windows < found.speed.size - steps]
    windows = windows[found.vehicle[windows] == found.vehicle[windows + steps]]
    drops = found.speed[windows] - found.speed[windows + steps]
    lost = cut_ins["lead_speed"] - cut_ins[f"speed_{WINDOW:.1f}"]
    lost = lost.dropna()
    row = {"kilometres": kilometres, "collisions": found.collisions, "cut_ins": len(cut_ins)}
    row |= {"lane_changes_per_km": found.changes.sum() / kilometres}
    row |= {"cut_ins_per_km": (found.changes & (found.behind >= 0)).sum() / kilometres}
    row |= {"windows": drops.size} | {f"drops_above_{by}": np.mean(drops > by) for by in (3, 5)}
    row |= dict(zip((f"gap_{level}" for level in LEVELS), _time_gaps(found), strict=True))
    return row | {"followed": lost.size} | {f"lost_above_{by}": np.mean(lost > by) for by in (1, 2)}


def _time_gaps(found: Trajectories) -> list[float]:
    """Return quantiles of the time gap of the vehicles that follow others [s]."""
    gap, behind = found.gaps(), found.behind
    speed = np.where(behind < 0, 0.0, found.speed[behind])
    follows = (found.frame % (WINDOW * RATE) == 0) & (gap > 0) & (gap < FAR) & (speed > FASTER)
    if not follows.any():
        return [np.nan] * len(LEVELS)
    return np.quantile(gap[follows] / speed[follows], LEVELS).tolist()


def calibration(rows: pd.DataFrame) -> pd.DataFrame:
    """Return the mean statistics of all worlds next to those of NGSIM."""
    return pd.DataFrame(
        [
            {
                "statistic": known.statistic,
                "ngsim": known.ngsim,
                "low": known.limits[0],
                "high": known.limits[1],
                "limits": known.reason,
                "motorway": rows[name].mean(),
                "smallest_part": rows[name].min(),
                "largest_part": rows[name].max(),
                "within": known.limits[0] <= rows[name].mean() <= known.limits[1],
            }
            for name, known in REFERENCES.items()
        ]
    )


def main() -> None:
    """Write the table of all worlds."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("rows", nargs="+", help="CSV files with the rows about the traffic")
    parser.add_argument("--output", required=True)
    arguments = parser.parse_args()
    table = calibration(pd.concat(map(pd.read_csv, arguments.rows)))
    write_csv(arguments.output, table.round(3))


if __name__ == "__main__":
    run_command(main)
