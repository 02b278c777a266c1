"""The paper's three ways to an accelerated distribution, by name."""

import os
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
import pandas as pd

from accelerated_evaluation.distributions import Empirical, from_dict
from accelerated_evaluation.files import read_json, write_json
from accelerated_evaluation.laws.lane_change_model import LaneChangeModel, read_model
from accelerated_evaluation.methods.cross_entropy.families import PiecewiseFamily, SingleFamily
from accelerated_evaluation.methods.cross_entropy.search import Search, Settings, Shift, search
from accelerated_evaluation.problem import CutIn, Proposal
from accelerated_evaluation.vehicles.loading import load_vehicle
from accelerated_evaluation.vehicles.protocol import Vehicle

METHODS = ("single", "piecewise", "heuristic")


def cut_ins(
    model: LaneChangeModel, encounters: pd.DataFrame, vehicle: Vehicle, closing_speed_max: float
) -> dict[str, CutIn]:
    """Set up the problem of each segment: v_L as recorded in it, R^-1 and TTC^-1 from the model."""
    speeds = encounters.groupby("segment")["lead_speed"]
    return {
        segment: CutIn(
            Empirical(speeds.get_group(segment)),
            Proposal(model.inverse_range, model.inverse_ttc[segment]),
            vehicle,
            closing_speed_max,
        )
        for segment in model.segments
    }


def load_cut_ins(
    model: str | os.PathLike, encounters: str | os.PathLike, vehicle: Mapping[str, Any]
) -> tuple[LaneChangeModel, dict[str, CutIn]]:
    """Read a model file and an encounter table, load the vehicle, and set up the problem of each segment.

    Parameters
    ----------
    vehicle
        Section ``vehicle`` of the configuration.
    """
    fitted = read_model(model)
    car = load_vehicle(vehicle["name"], **vehicle["parameters"])
    return fitted, cut_ins(fitted, pd.read_parquet(encounters), car, vehicle["closing_speed_max"])


def search_by_method(
    method: str,
    problem: CutIn,
    config: Mapping[str, Any],
    generator: np.random.Generator,
    on_iteration: Callable[[dict[str, float]], None] = lambda _: None,
) -> Search:
    """Search f* of one segment.

    ``single`` moves one exponential for each variable, ``piecewise`` tilts and reweighs the pieces of f, and
    ``heuristic`` shifts their truncation points as well.

    Parameters
    ----------
    config
        Section ``cross_entropy`` of the configuration.
    """
    f = problem.model
    if method == "single":
        start = SingleFamily.start(f.inverse_range), SingleFamily.start(f.inverse_ttc)
    else:
        limits = config["minimum_weight"], config["minimum_piece_events"]
        start = PiecewiseFamily.start(f.inverse_range, *limits), PiecewiseFamily.start(f.inverse_ttc, *limits)
    settings = Settings(**{name: config[name] for name in Settings.__dataclass_fields__})
    shift = Shift(**config["truncation_shift"]) if method == "heuristic" else None
    return search(problem, *start, settings, generator, shift=shift, on_iteration=on_iteration)


def write_proposals(path: str | os.PathLike, proposals: Mapping[str, Proposal]) -> None:
    """Write f* of each segment as JSON, atomically."""
    content = {
        segment: {"inverse_range": f.inverse_range.to_dict(), "inverse_ttc": f.inverse_ttc.to_dict()}
        for segment, f in proposals.items()
    }
    write_json(path, content)


def read_proposals(path: str | os.PathLike) -> dict[str, Proposal]:
    """Read what `write_proposals` wrote."""
    return {
        segment: Proposal(from_dict(laws["inverse_range"]), from_dict(laws["inverse_ttc"]))
        for segment, laws in read_json(path).items()
    }
