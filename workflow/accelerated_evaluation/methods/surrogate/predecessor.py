"""Runs of a vehicle that is similar to the one under test, from the table of an earlier estimate."""

import os

import numpy as np

from accelerated_evaluation.base.errors import InputError
from accelerated_evaluation.base.tables import read_csv, require_file
from accelerated_evaluation.methods.surrogate.gaussian_process import Predecessor
from accelerated_evaluation.problem import Problem

ROUNDING = 1e-6  # relative tolerance; laws that were fitted on two kinds of processor differ by less
FLAGS = {"True": True, "False": False}


def read_predecessor(path: str | os.PathLike, problem: Problem) -> Predecessor:
    """Return the runs of a similar vehicle from the table ``runs.csv`` of the command ``estimate``.

    Parameters
    ----------
    path
        The table.
    problem
        The problem of the new estimate. Its law must map the normal scores of the table to the same
        encounters.

    Raises
    ------
    InputError
        If the table is missing or is not a table of simulations, belongs to another law, or contains no
        event.
    """
    change = "Name the runs.csv that `estimate` wrote for a similar vehicle, with the same law and records."
    require_file(path, change)
    names = [*problem.coordinates(np.zeros((1, problem.dimension)))]
    scores = [f"z_{name}" for name in names]
    table = read_csv(path, {name: name for name in (*scores, *names, "event")})
    try:
        z, recorded = table[scores].to_numpy(float), table[names].to_numpy(float)
        happened = np.array([FLAGS[flag] for flag in table["event"]], bool)
    except (ValueError, KeyError) as error:
        expected = "numbers, and True or False for the event"
        raise InputError(str(path), seen=f"a cell {error}", expected=expected, change=change) from error
    if not happened.any():
        seen = f"no event in {len(z)} simulations"
        raise InputError(str(path), seen=seen, expected="at least one event", change=change)
    own = problem.coordinates(z)
    if not np.allclose(np.column_stack([own[name] for name in names]), recorded, rtol=ROUNDING, atol=0):
        expected = "encounters of the law of this estimate, fitted to the same records"
        raise InputError(str(path), seen="encounters of another law", expected=expected, change=change)
    return Predecessor(z, happened)
