"""What the tests of recordings share: lanes over time, settings, and checks of account and cut-ins."""

import copy
from itertools import pairwise

import numpy as np
import pandas as pd
from accelerated_evaluation import SOURCES
from accelerated_evaluation.study.configuration import load

RATE = 25
MOMENT = 75  # frame of the change of lane
FRAMES = 150
LENGTH = 4.0


def stays(*lanes):
    """Return the lane of each frame, from pairs of a first frame and a lane."""
    return lambda frame: [lane for first, lane in lanes if frame >= first or first == 0][-1]


def settings(source, folder, **changes):
    """Return the section of a source with a folder of recordings; ``rule__stay`` is the key stay of rule."""
    section = copy.deepcopy(load()["data"][source]) | {"path": str(folder)}
    for key, value in changes.items():
        above, _, last = key.rpartition("__")
        (section[above] if above else section)[last] = value
    return section


def extract(source, folder, **changes):
    return SOURCES[source].read(settings(source, folder, **changes))


def damage(file, old, new):
    """Replace a text that a file contains."""
    assert old in file.read_text()
    file.write_text(file.read_text().replace(old, new))


def adds_up(cut_ins, cases):
    """Tell whether the account leads from the rows of all cases, (rows, classes, cut-ins), to the cut-ins."""
    lines = cut_ins.attrs["account"]
    steps = all(
        line["rows_in"] == before["rows_kept"] == before["rows_in"] - before["rows_dropped"]
        for before, line in pairwise(lines)
    )
    return steps and (lines[0]["rows_in"], lines[-1]["rows_kept"], len(cut_ins)) == (
        sum(len(rows) for rows, *_ in cases.values()),
        *2 * [sum(count for *_, count in cases.values())],
    )


def is_driving_of(exposure, *speeds):
    """Tell whether the exposure is that of vehicles that drive through all frames at these speeds [m/s]."""
    hours = (FRAMES - 1) / RATE / 3600
    driven = [len(speeds) * hours, 3.6 * sum(speeds) * hours]
    return np.allclose([exposure["hours"], exposure["kilometres"]], driven, rtol=1e-6, atol=0)


def write_shuffled(folder, other):
    """Write the files of a folder into another one, with their rows in another order."""
    for file in folder.iterdir():
        pd.read_csv(file, dtype=str).sample(frac=1, random_state=1).to_csv(other / file.name, index=False)


def agree(found, planted, tolerances):
    """Tell whether the planted cut-ins were found, no others, and with their values.

    ``tolerances`` has a relative and an absolute one by column.
    """
    both = planted.merge(found, on=["recording", "vehicle", "host"], suffixes=("", "_found"))
    same = all(
        np.allclose(both[f"{name}_found"], both[name], rtol=relative, atol=absolute)
        for name, (relative, absolute) in tolerances.items()
    )
    return same and len(both) == len(planted) == len(found)
