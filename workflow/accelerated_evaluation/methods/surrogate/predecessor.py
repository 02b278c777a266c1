"""Runs of a vehicle that is similar to the one under test, from the table of an earlier estimate."""

import os

import numpy as np

from accelerated_evaluation.base.errors import InputError
from accelerated_evaluation.base.tables import read_csv, require_file
from accelerated_evaluation.laws import Law
from accelerated_evaluation.methods.surrogate.gaussian_process import Predecessor

VARIABLES = ("lead_speed", "inverse_range", "inverse_ttc")
ROUNDING = 1e-6  # relative; laws that were fitted on two kinds of processor differ by less
FLAGS = {"True": True, "False": False}


def read_predecessor(path: str | os.PathLike, law: Law) -> Predecessor:
    """Read a table of simulations, as the command ``estimate`` writes it to ``runs.csv``.

    Parameters
    ----------
    path
        The table.
    law
        The law of the new estimate. It must map the normal scores of the table to the same cut-ins.

    Raises
    ------
    InputError
        If the table is missing or is not a table of simulations, belongs to another law, or contains no
        event.
    """
    change = "Name the runs.csv that `estimate` wrote for a like vehicle, under the same law and records."
    require_file(path, change)
    scores = [f"z_{name}" for name in VARIABLES]
    table = read_csv(path, {name: name for name in (*scores, *VARIABLES, "event")})
    try:
        z, recorded = table[scores].to_numpy(float), table[[*VARIABLES]].to_numpy(float)
        happened = np.array([FLAGS[flag] for flag in table["event"]], bool)
    except (ValueError, KeyError) as error:
        expected = "numbers, and True or False for the event"
        raise InputError(str(path), seen=f"a cell {error}", expected=expected, change=change) from error
    if not happened.any():
        seen = f"no event in {len(z)} simulations"
        raise InputError(str(path), seen=seen, expected="at least one", change=change)
    cut_ins = law.from_normal_scores(z)
    own = np.column_stack([getattr(cut_ins, name) for name in VARIABLES])
    if not np.allclose(own, recorded, rtol=ROUNDING, atol=0):
        expected = f"cut-ins of the law {law.description!r}, fitted to the same records"
        raise InputError(str(path), seen="cut-ins of another law", expected=expected, change=change)
    return Predecessor(z, happened)
