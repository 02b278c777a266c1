"""Derive the two tables in data/europe from the published file of cut-ins; see the README there.

python benchmarks/europe/derive.py cut-in.json data/europe
"""

import argparse
import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from accelerated_evaluation.base.files import atomic_path, write_csv
from scipy.interpolate import BSpline

MARKING = 1.75  # [m] from the axis of the host's lane, half of a lane of 3.5 m
CENTRE = 3.0  # [m]; a lane change that begins farther away is recorded from the centre of its lane on
DRIFT = 0.375  # [m], after which a lane change is visible (UN R157, careful and competent driver)
BEFORE = 2.0  # [s] before the crossing, over which the change of the host's speed is measured
LARGEST_CONTRADICTION = 3.0  # [m/s] between the change of the range and the speeds
AFTER = range(1, 9)  # [s], times after the moment of the cut-in at which the lead speed is kept
SPEEDS = [f"speed_{after:.1f}" for after in AFTER]
POINTS = 400  # at which the lateral position is evaluated


class Course:
    """A quantity over time, which is a spline in each of several consecutive activities of a car.

    Parameters
    ----------
    activities
        Activities, each with start [s], end [s], and the knots, coefficients and degree of its spline.
    """

    def __init__(self, activities: Sequence[tuple[float, float, Sequence, Sequence, int]]) -> None:
        self._parts = sorted(activities, key=lambda part: part[0])

    def __call__(self, times: np.ndarray | float) -> np.ndarray:
        """Return the quantity at the given times [s], NaN when no activity is recorded."""
        times = np.asarray(times, dtype=float)
        values = np.full(times.shape, np.nan)
        for start, end, knots, coefficients, degree in self._parts:
            inside = np.isnan(values) & (times >= start) & (times <= end)
            phase = np.minimum((times[inside] - start) / (end - start), 1 - 1e-9)
            values[inside] = BSpline(np.asarray(knots), np.asarray(coefficients), degree)(phase)
        return values


def cut_in(number: int, scenario: Mapping[str, Any], content: Mapping[str, Any]) -> dict[str, object]:
    """Return the row of one scenario of the published file."""
    acts = [content["activity"][str(act["activity"])] for act in scenario["acts"]]
    across = _course([act for act in acts if act["name"].endswith("lane change")], content)
    target = [act for act in acts if act["name"].endswith("target")]
    lead_speed, range_ = (_course(target, content, quantity) for quantity in (0, 1))
    ego = [act for act in acts if act["name"].endswith("ego") and "lane keeping" not in act["name"]]
    host_speed = _course(ego, content)
    start, end = (_time(scenario[side], content) for side in ("start", "end"))
    times = np.linspace(start, end, POINTS)
    moment = (start + end) / 2
    lead, host = float(lead_speed(moment)), float(host_speed(moment))
    change = float(range_(end) - range_(start)) / (end - start)
    actors = [content["actor"][str(actor["uid"])]["properties"] for actor in scenario["actors"]]
    file = next(properties["filename"] for properties in actors if properties)
    return {
        "scenario": number,
        "recording": file.replace("\\", "/").rpartition("/")[2].removesuffix(".hdf5"),
        "lead_speed": lead,
        "range": float(range_(moment)),
        "closing_speed": host - lead,
        "contradiction": change - float(np.mean(lead_speed(times) - host_speed(times))),
        **_crossing(times, np.abs(across(times)), host_speed),
        **{name: float(lead_speed(moment + after)) for name, after in zip(SPEEDS, AFTER, strict=True)},
    }


def _crossing(times: np.ndarray, distance: np.ndarray, host_speed: Course) -> dict[str, float]:
    """Return what happened before the marking was crossed, NaN if it was crossed before or after.

    ``distance`` [m] is the distance of the other car from the axis of the host's lane at ``times`` [s].
    """
    row: dict[str, float] = {"seen": np.nan, "lateral_speed": np.nan, "host_change": np.nan}
    if not distance[0] > MARKING >= distance.min():
        return row
    at = int(np.argmax(distance <= MARKING))
    row["lateral_speed"] = (distance[at - 1] - distance[at]) / (times[at] - times[at - 1])
    row["host_change"] = float(host_speed(times[at]) - host_speed(times[at] - BEFORE))
    if distance[0] >= CENTRE:
        row["seen"] = times[at] - times[int(np.argmax(distance <= distance[0] - DRIFT))]
    return row


def _course(
    activities: Sequence[Mapping[str, Any]], content: Mapping[str, Any], of: int | None = None
) -> Course:
    """Return a quantity of consecutive activities; ``of`` is its place if each has several quantities."""
    parts = []
    for activity in activities:
        values = [activity["parameters"][key] for key in ("knots", "coefficients", "degree")]
        values = values if of is None else [value[of] for value in values]
        parts.append((*(_time(activity[side], content) for side in ("start", "end")), *values))
    return Course(parts)


def _time(event: Mapping[str, Any], content: Mapping[str, Any]) -> float:
    """Return the time of an event [s]."""
    return content["event"][str(event["uid"])]["conditions"]["time"]


def derive(content: Mapping[str, Any], folder: Path) -> pd.Series:
    """Write both tables, and return the numbers of the scenarios that were left out."""
    table = pd.DataFrame(
        [cut_in(number, each, content) for number, each in enumerate(content["scenario"].values(), 1)]
    )
    wrong = table["contradiction"].abs() > LARGEST_CONTRADICTION
    kept = table[~wrong].drop(columns="contradiction").round(3)
    write_csv(folder / "cut_ins.csv", kept.drop(columns=SPEEDS))
    followed = kept.dropna(subset=SPEEDS)
    columns = ["scenario", "lead_speed", "range", "closing_speed", *SPEEDS]
    with atomic_path(folder / "lead_motion.parquet") as temporary:
        followed[columns].to_parquet(temporary, index=False)
    return table.loc[wrong, "scenario"]


def main() -> None:
    """Write the tables, and print which scenarios were left out."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("published", type=Path, help="the published file, cut-in.json")
    parser.add_argument("folder", type=Path, help="to write the tables to")
    given = parser.parse_args()
    left_out = derive(json.loads(given.published.read_text()), given.folder)
    print(f"left out, because range and speeds contradict each other: {left_out.tolist()}")


if __name__ == "__main__":
    main()
