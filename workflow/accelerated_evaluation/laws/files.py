"""Law files: a readable JSON format, which only this module writes and reads."""

import math
import os
from itertools import product

import numpy as np
import pandas as pd

from accelerated_evaluation.base.errors import InputError
from accelerated_evaluation.base.files import read_json, write_json
from accelerated_evaluation.base.tables import require_file
from accelerated_evaluation.laws import LAWS, Law

FORMAT = "accelerated-evaluation law"
VERSION = 2
PLACES = (-4.0, 0.0, 4.0)  # normal scores at which a law that was read is checked


def write_law(path: str | os.PathLike, law: Law) -> None:
    """Write a law as JSON, atomically; `read_law` returns a law that is equal to it."""
    cap = None if math.isinf(law.closing_speed_max) else law.closing_speed_max
    header = {"format": FORMAT, "version": VERSION, "kind": law.kind, "description": law.description}
    write_json(path, header | {"closing_speed_max": {"unit": "m/s", "value": cap}} | law.content())


def read_law(path: str | os.PathLike, encounters: pd.DataFrame) -> Law:
    """Read a law file.

    Parameters
    ----------
    path
        The file.
    encounters
        The encounter table to which the law was fitted; it supplies the lead speeds.

    Raises
    ------
    InputError
        If the file is missing, is not a law of this version, or does not fit the encounters.
    """
    change = "Fit the law again, or name a law file that this version wrote."
    require_file(path, change)
    try:
        content = read_json(path)
        kind = content["format"], content["version"]
        if kind != (FORMAT, VERSION):
            raise InputError(str(path), seen=f"{kind}", expected=f"{(FORMAT, VERSION)}", change=change)
        if content["kind"] not in LAWS:
            seen = f"a law of kind {content['kind']!r}"
            raise InputError(str(path), seen=seen, expected=f"one of {', '.join(LAWS)}", change=change)
        cap = content["closing_speed_max"]["value"]
        law = LAWS[content["kind"]].from_content(
            content, encounters, content["description"], math.inf if cap is None else float(cap)
        )
        _require_cut_ins(law)
        return law
    except (AttributeError, KeyError, TypeError, ValueError) as error:
        seen = f"{type(error).__name__}: {error}"
        raise InputError(str(path), seen=seen, expected="a complete law file", change=change) from error


def _require_cut_ins(law: Law) -> None:
    """Raise ValueError if a law has no description, no cap above 0, or cut-ins that cannot be."""
    if not isinstance(law.description, str):
        raise ValueError(f"the description {law.description!r}")
    if not law.closing_speed_max > 0:
        raise ValueError(f"closing speeds up to {law.closing_speed_max:g} m/s")
    with np.errstate(all="ignore"):
        cut_ins = law.from_normal_scores(np.array([*product(PLACES, repeat=3)]))
    possible = (cut_ins.lead_speed >= 0) & (cut_ins.inverse_range > 0) & (cut_ins.inverse_ttc >= 0)
    if not (possible & np.isfinite([*vars(cut_ins).values()]).all(axis=0)).all():
        raise ValueError("cut-ins with a range that is not above 0, or with a speed below 0 or without end")
