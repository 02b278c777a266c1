"""Law files: a readable JSON format for laws of all scenarios, which only this module writes and reads."""

import hashlib
import json
import os
from collections.abc import Iterable, Mapping
from itertools import product
from typing import Any

import numpy as np
import pandas as pd

from accelerated_evaluation.base.checking import checked
from accelerated_evaluation.base.errors import InputError, located, readable
from accelerated_evaluation.base.files import read_json, require_format, value_digest, write_json
from accelerated_evaluation.base.tables import require_file
from accelerated_evaluation.laws import LAWS, Box, Law
from accelerated_evaluation.records.segments import NUMBERS
from accelerated_evaluation.records.verdict import Verdict

FORMAT = "accelerated-evaluation law"
CHECKSUM = "checksum"
VERSION = 2  # files of version 1 have no checksum, and no factors of the far tail by place
PLACES = (-4.0, 0.0, 4.0)  # normal scores at which a law is checked after reading
NOT_CHECKED = {"stops": {}, "warnings": ["no verdict on the records in the file of the law"], "advice": {}}
CHANGE = "Fit the law again, or name a law file that this version wrote."


@checked()
def write_law(
    path: str | os.PathLike, law: Law, records: pd.DataFrame | None = None, verdict: Verdict | None = None
) -> None:
    """Write a law as JSON, atomically; `read_law` returns an equal law.

    Parameters
    ----------
    path
        File to write.
    law
        The law.
    records
        The encounter table to which a law of cut-ins was fitted, from which it takes its lead speeds. A
        digest of the table is written to the file, by which `read_law` refuses other tables. Other laws need
        no table.
    verdict
        The verdict on the records, which `read_verdict` returns; None if they were not checked.

    Examples
    --------
    >>> import accelerated_evaluation as ae
    >>> law = ae.choose_draws("independent_variables", ae.read_records("left_turn")).law
    >>> ae.write_law("law.json", law)
    """
    checked = {} if verdict is None else {"verdict": verdict.content()}
    write_json(path, signed(law_content(law, records) | checked))


def law_content(law: Law, records: pd.DataFrame | None) -> dict[str, Any]:
    """Return what a law file says of a law; it also has a checksum, and may have a verdict on the records."""
    header = {"format": FORMAT, "version": VERSION, "kind": law.kind, "description": law.description}
    header |= {"variables": law.box.content()}
    if law.uses_records:
        header |= {"records": _described(records)}
    return header | law.content()


def signed(content: Mapping[str, Any]) -> dict[str, Any]:
    """Return the content of a law file with its checksum, which an edited or damaged file does not have."""
    plain = json.loads(json.dumps({key: value for key, value in content.items() if key != CHECKSUM}))
    return plain | {CHECKSUM: value_digest(plain)}


def _read(path: str | os.PathLike) -> dict[str, Any]:
    """Return the content of a law file; InputError is raised if it is not as this version wrote it."""
    content = read_json(path)
    require_format(path, content, FORMAT, VERSION, CHANGE)
    if content.get(CHECKSUM) != signed(content)[CHECKSUM]:
        seen = "a checksum that does not agree with the content, so the file was edited or damaged"
        raise InputError(str(path), seen=seen, expected="the file as it was written", change=CHANGE)
    return content


def _described(records: pd.DataFrame) -> dict[str, int | str]:
    """Return the number of rows of an encounter table and the digest of its content."""
    numbers = np.ascontiguousarray(records[list(NUMBERS)].to_numpy(dtype="<f8"))
    digest = hashlib.sha256(numbers.tobytes())
    digest.update("\n".join(records["segment"].tolist()).encode())
    return {"rows": len(records), "sha256": digest.hexdigest()}


@checked()
def read_law(path: str | os.PathLike, records: pd.DataFrame | None = None) -> Law:
    """Return the law that a law file describes.

    Parameters
    ----------
    path
        The file.
    records
        The encounter table to which a law of cut-ins was fitted; other laws need none.

    Raises
    ------
    InputError
        If the file is missing, is not a law file of this version, has been edited or damaged, or belongs to
        another encounter table, and if it needs a table and none is given.

    Examples
    --------
    >>> import accelerated_evaluation as ae
    >>> law = ae.choose_draws("independent_variables", ae.read_records("left_turn")).law
    >>> ae.write_law("law.json", law)
    >>> ae.read_law("law.json").box.names == law.box.names
    True
    """
    require_file(path, CHANGE)
    with readable(str(path), "a complete law file", CHANGE):
        content = _read(path)
        if content["kind"] not in LAWS:
            seen = f"a law of kind {content['kind']!r}"
            raise InputError(str(path), seen=seen, expected=f"one of {', '.join(LAWS)}", change=CHANGE)
        kind = LAWS[content["kind"]]
        if kind.needs_records or "records" in content:
            _require_table(path, records, content["records"])
        with located(str(path)):
            box = Box.from_content(content["variables"])
            law = kind.from_content(content, box, records)
        _require_possible(law, box)
        json.dumps(law.content(), allow_nan=False)  # raises ValueError if a number is NaN or infinite
    return law


def names_records(path: str | os.PathLike) -> bool:
    """Return whether a law file names the encounter table to which its law was fitted."""
    with readable(str(path), "a complete law file", CHANGE):
        return "records" in _read(path)


def read_verdict(path: str | os.PathLike, accepted: Iterable[str] = ()) -> Verdict:
    """Return the verdict on the records of a law, which its file contains.

    InputError is raised if a check has the verdict ``stop`` and ``accepted`` does not name it, or if the file
    cannot be read.
    """
    require_file(path, CHANGE)
    with readable(f"{path}, verdict", "a verdict on records", CHANGE):
        verdict = Verdict.from_content(_read(path).get("verdict", NOT_CHECKED), accepted)
    verdict.require_accepted(str(path))
    return verdict


def _require_table(
    path: str | os.PathLike, records: pd.DataFrame | None, expected: Mapping[str, Any]
) -> None:
    where = f"{path}, the encounter table of this law"
    change = "Name the encounter table, or the configuration, of the study to which the law belongs."
    if records is None:
        raise InputError(where, seen="no table", expected="the table of the law", change=change)
    if (given := _described(records)) != expected:
        raise InputError(
            where,
            seen=f"another table: {_table(given)}",
            expected=f"the table to which the law was fitted: {_table(expected)}",
            change=change,
        )


def _table(fitted: Mapping[str, Any]) -> str:
    return f"{fitted['rows']:,} rows with the SHA-256 checksum {fitted['sha256'][:12]}..."


def _require_possible(law: Law, box: Box) -> None:
    """Raise ValueError if a law has no description, another box, or impossible points or densities."""
    if law.box != box:
        raise ValueError(f"variables {box} in a law of {law.box}")
    if not isinstance(law.description, str):
        raise ValueError(f"a description that is not a text: {law.description!r}")
    with np.errstate(all="ignore"):
        x = law.from_normal_scores(np.array([*product(PLACES, repeat=law.dimension)]))
        possible = np.isfinite(x).all() and law.box.contains(x).all()
        if not possible or np.isnan(law.log_density(x)).any():
            raise ValueError("parameters that give points outside the limits, or no density")
