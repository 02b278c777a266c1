"""Law files: a readable JSON format, which only this module writes and reads."""

import hashlib
import json
import math
import os
from collections.abc import Mapping
from itertools import product
from typing import Any

import numpy as np
import pandas as pd

from accelerated_evaluation.base.errors import InputError
from accelerated_evaluation.base.files import read_json, require_format, write_json
from accelerated_evaluation.base.tables import require_file
from accelerated_evaluation.laws import LAWS, Law
from accelerated_evaluation.records.encounter_table import NUMBERS

FORMAT = "accelerated-evaluation law"
VERSION = 2
PLACES = (-4.0, 0.0, 4.0)  # normal scores at which a law is checked after reading


def write_law(path: str | os.PathLike, law: Law, encounters: pd.DataFrame | None = None) -> None:
    """Write a law as JSON, atomically; `read_law` returns an equal law.

    Parameters
    ----------
    path
        File to write.
    law
        The law.
    encounters
        The encounter table to which the law was fitted. A digest of the table is written to the file, so that
        `read_law` can refuse other tables.
    """
    cap = None if math.isinf(law.closing_speed_max) else law.closing_speed_max
    header = {"format": FORMAT, "version": VERSION, "kind": law.kind, "description": law.description}
    if encounters is not None:
        header |= {"encounters": _described(encounters)}
    write_json(path, header | {"closing_speed_max": {"unit": "m/s", "value": cap}} | law.content())


def _described(encounters: pd.DataFrame) -> dict[str, int | str]:
    """Return the number of rows of an encounter table and the digest of its content."""
    numbers = np.ascontiguousarray(encounters[list(NUMBERS)].to_numpy(dtype="<f8"))
    digest = hashlib.sha256(numbers.tobytes())
    digest.update("\n".join(encounters["segment"].tolist()).encode())
    return {"rows": len(encounters), "sha256": digest.hexdigest()}


def read_law(path: str | os.PathLike, encounters: pd.DataFrame) -> Law:
    """Return the law that a law file describes.

    Parameters
    ----------
    path
        The file.
    encounters
        The encounter table to which the law was fitted; it supplies the lead speeds.

    Raises
    ------
    InputError
        If the file is missing, is not a law file of this version, or belongs to another encounter table.
    """
    change = "Fit the law again, or name a law file that this version wrote."
    require_file(path, change)
    try:
        content = read_json(path)
        require_format(path, content, FORMAT, VERSION, change)
        if content["kind"] not in LAWS:
            seen = f"a law of kind {content['kind']!r}"
            raise InputError(str(path), seen=seen, expected=f"one of {', '.join(LAWS)}", change=change)
        cap = content["closing_speed_max"]["value"]
        law = LAWS[content["kind"]].from_content(
            content, encounters, content["description"], math.inf if cap is None else float(cap)
        )
        _require_cut_ins(law)
        json.dumps(law.content(), allow_nan=False)  # raises ValueError if a number is NaN or infinite
        if "encounters" in content:
            given = _described(encounters)
            _require_equal(path, _table(given), _table(content["encounters"]), given == content["encounters"])
        return law
    except (ArithmeticError, AttributeError, LookupError, TypeError, ValueError) as error:
        seen = f"{type(error).__name__}: {error}"
        raise InputError(str(path), seen=seen, expected="a complete law file", change=change) from error


def require_shares(path: str | os.PathLike, law: Law, encounters: pd.DataFrame) -> None:
    """Raise InputError unless a law and a table have the same share of encounters in each segment.

    This check is for law files of earlier versions. They have no digest of the encounter table, with which
    `read_law` could compare the whole table.

    Parameters
    ----------
    path
        The law file, for the error.
    law
        The law.
    encounters
        The encounter table.
    """
    counts = encounters["segment"].value_counts()
    recorded = {segment: count / len(encounters) for segment, count in counts.items()}
    _require_equal(path, _shares(recorded), _shares(law.shares), dict(law.shares) == recorded)


def _require_equal(path: str | os.PathLike, seen: str, expected: str, is_equal: bool) -> None:
    if not is_equal:
        raise InputError(
            f"{path}, the encounter table of this law",
            seen=f"another table: {seen}",
            expected=f"the table to which the law was fitted: {expected}",
            change="Name the encounter table, or the configuration, of the study to which the law belongs.",
        )


def _table(fitted: Mapping[str, Any]) -> str:
    return f"{fitted['rows']:,} rows with the SHA-256 checksum {fitted['sha256'][:12]}..."


def _shares(shares: Mapping[str, float]) -> str:
    return ", ".join(f"{segment} m/s ({share:.3%})" for segment, share in sorted(shares.items()))


def _require_cut_ins(law: Law) -> None:
    """Raise ValueError if a law has no description, no cap above 0, or draws impossible cut-ins."""
    if not isinstance(law.description, str):
        raise ValueError(f"a description that is not a text: {law.description!r}")
    if not law.closing_speed_max > 0:
        raise ValueError(f"a cap on closing speeds of {law.closing_speed_max:g} m/s")
    with np.errstate(all="ignore"):
        cut_ins = law.from_normal_scores(np.array([*product(PLACES, repeat=3)]))
    possible = (cut_ins.lead_speed >= 0) & (cut_ins.inverse_range > 0) & (cut_ins.inverse_ttc >= 0)
    if not (possible & np.isfinite([*vars(cut_ins).values()]).all(axis=0)).all():
        raise ValueError("cut-ins with a range that is not positive, or a speed that is negative or infinite")
