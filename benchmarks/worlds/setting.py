"""What all worlds share: fits to the records, from which they are made, and the vehicle's map."""

import argparse
import pickle
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd
import yaml
from accelerated_evaluation.base.arrays import Array
from accelerated_evaluation.base.files import atomic_path
from accelerated_evaluation.base.randomness import child_generator
from accelerated_evaluation.crash_map.lines import CrashLines
from accelerated_evaluation.crash_map.mapping import map_crashes
from accelerated_evaluation.crash_map.maps import Grid
from accelerated_evaluation.crash_map.sensitivity import Levels
from accelerated_evaluation.laws.paper.models import IndependentLaw, fit_paper_laws
from accelerated_evaluation.laws.smooth.draws import SmoothDraws
from accelerated_evaluation.laws.smooth.family import DistinctRecords, Fitter, LawFamily, members_at
from accelerated_evaluation.laws.smooth.support import SUPPORT
from accelerated_evaluation.records.segments import assign_segments
from accelerated_evaluation.vehicles.builtin.acc_aeb import AccAeb
from beyond import worlds_beyond
from kinds import World, worlds

ROOT = 2016  # root of all randomness, as in the study
MEMBERS = members_at((0.9, 0.95, 0.98))  # fewer thresholds than in the study, to save time
LINES = 1200  # of the thinned map
TOP = 45.0  # [m/s], where the scan of the map ends


@dataclass(frozen=True)
class WorldSettings:
    """Lead speeds and lengths of runs as recorded, fits, levels of the paper's knots, and thinned map."""

    lead_speeds: Array
    run_lengths: Array
    family: LawFamily
    law: IndependentLaw
    levels: Levels
    lines: CrashLines


def runs_of(records: pd.DataFrame) -> tuple[pd.DataFrame, Array]:
    """Return the distinct records, and how many rows each stands for."""
    first = ~(records == records.shift()).all(axis=1).to_numpy()
    return records[first], np.diff(np.flatnonzero(first), append=len(records))


def distinct_records(records: pd.DataFrame) -> tuple[DistinctRecords, Array]:
    """Return the distinct records, and how many rows each stands for."""
    distinct, lengths = runs_of(records)
    speed, inverse_range, inverse_ttc = (
        distinct[name].to_numpy() for name in ("lead_speed", "inverse_range", "inverse_ttc")
    )
    range_ = np.minimum(1 / inverse_range, SUPPORT.range_max)
    return DistinctRecords(speed, range_, inverse_ttc / inverse_range), lengths


def prepare(config: dict) -> WorldSettings:
    """Fit, and map the crashes; the lines of the map are thinned for the worlds of all kinds."""
    records = pd.read_parquet(config["data"]["spmd"]["path"])
    distinct, lengths = distinct_records(records)
    speed = distinct.lead_speed
    family = Fitter(distinct, MEMBERS).fit()
    segmented = assign_segments(records, config["segments"]["lead_speed_edges"])
    law = fit_paper_laws(segmented, config["models"], config["filters"]["range_max"], "records", np.inf)[
        "two_pieces"
    ]
    grid = Grid(
        lead_speed_min=5,
        lead_speed_max=35,
        range_max=75,
        lead_speed_cells=30,
        range_cells=50,
        refinement=12,
        closing_speed_max=TOP,
        closing_speed_points=240,
    )
    lines = CrashLines.of(map_crashes(AccAeb(), grid, [], child_generator(ROOT, "worlds", "map")), speed)
    made = worlds(family, law) | worlds_beyond(family)
    laws = [world.masses(lines) for world in made.values()]
    laws += list(lines.masses(SmoothDraws.of_laws(family.ranges, [family.law(each) for each in MEMBERS])))
    mean = np.mean([masses / masses.sum() for masses in laws], axis=0)
    thinned = lines.thinned(np.bincount(lines.row, mean), LINES, child_generator(ROOT, "worlds", "lines"))
    return WorldSettings(speed, lengths, family, law, Levels.of(law), thinned)


def simulate_records(world: World, setting: WorldSettings, generator: np.random.Generator) -> pd.DataFrame:
    """Draw as many cut-ins as were recorded, and repeat rows as often as they repeat in the record."""
    size = setting.lead_speeds.size
    drawn = world.draw(generator.choice(setting.lead_speeds, size), generator)
    inverse_range = 1 / np.minimum(drawn.range_, SUPPORT.range_max)
    columns = drawn.lead_speed, inverse_range, drawn.closing_speed * inverse_range
    lengths = generator.permutation(setting.run_lengths)
    return pd.DataFrame(
        {
            name: np.repeat(column, lengths)
            for name, column in zip(("lead_speed", "inverse_range", "inverse_ttc"), columns, strict=True)
        }
    )


def read_setting(path: str | Path) -> WorldSettings:
    """Read what this script wrote."""
    return pickle.loads(Path(path).read_bytes())


def main() -> None:
    """Write the setting."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--config", default="config/config.yaml")
    parser.add_argument("--output", required=True)
    arguments = parser.parse_args()
    config = yaml.safe_load(Path(arguments.config).read_text(encoding="utf-8"))
    setting = prepare(config)
    with atomic_path(arguments.output) as temporary:
        temporary.write_bytes(pickle.dumps(setting))


if __name__ == "__main__":
    # Pickled under its importable name, so that other scripts can read it.
    from setting import main as importable

    importable()
