"""The file of a scored family of laws, so that a study fits it once."""

import hashlib
import json
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from accelerated_evaluation.answer import candidates
from accelerated_evaluation.answer.candidates.calibration import DIVISIONS
from accelerated_evaluation.answer.candidates.smooth_family import SmoothFamily, named
from accelerated_evaluation.base.arrays import Array
from accelerated_evaluation.base.errors import DAMAGE, InputError, readable
from accelerated_evaluation.base.extensions import known
from accelerated_evaluation.base.files import atomic_path, content_digest, read_arrays
from accelerated_evaluation.laws import smooth
from accelerated_evaluation.laws.smooth.excess import Excess
from accelerated_evaluation.laws.smooth.family import DistinctRecords, Fitter, Member
from accelerated_evaluation.laws.smooth.shapes import SHAPES
from accelerated_evaluation.laws.smooth.smooth_hazard import HazardGrid, SmoothHazard

FORMAT = "accelerated-evaluation family"
VERSION = 4
HAZARD = ("coefficients", "smoothing", "factor")
EXCESS = (*HAZARD, "parameters")
SCORING = ("scores.py", "calibration.py", "smooth_family.py")


def fit_or_read(path: str | os.PathLike, records: DistinctRecords) -> SmoothFamily:
    """Return the family of laws fitted to the given records, with its scores on held-out records.

    The family is read from its file. It is fitted, and the file is written, if there is no file, if the file
    was made for other records or by other code, or if it is damaged.
    """
    try:
        return read_family(path, records)
    except InputError:
        scored = SmoothFamily.of(records, calibrated=True)
        write_family(path, scored)
        return scored


def write_family(path: str | os.PathLike, scored: SmoothFamily) -> None:
    """Write a scored family to a family file, atomically; equal families give equal bytes."""
    family = scored.family
    header = _header(scored.records) | {"members": [member.name for member in scored.members]}
    arrays: dict[str, Any] = {"header": np.array(json.dumps(header)), "scores": scored.scores}
    arrays |= {f"expected, {name}": values for name, values in scored.expected.items()}
    for kind in ("ranges", "body"):
        arrays |= {f"{kind} {name}": getattr(getattr(family, kind), name) for name in HAZARD}
    for member in scored.members:
        if member in family.tails:
            arrays |= {f"tail {member.name}, {name}": getattr(family.tails[member], name) for name in EXCESS}
    with atomic_path(path) as temporary, temporary.open("wb") as file:
        np.savez(file, **arrays)


def read_family(path: str | os.PathLike, records: DistinctRecords) -> SmoothFamily:
    """Read a scored family from a file of `write_family`.

    InputError is raised if the file is missing or damaged, or was made for other records or by other code.
    """
    change = "Run the study, which fits the family of laws again."
    with readable(str(path), "a family file", change, (*DAMAGE, OSError)):
        arrays = read_arrays(path)
        header = json.loads(str(arrays.pop("header")))
        differing = [key for key, value in _header(records).items() if header[key] != value]
        if differing:
            seen, expected = f"another value of {' and '.join(differing)}", "the family of these records"
            raise InputError(str(path), seen=seen, expected=expected, change=change)
        return _from_arrays(arrays, tuple(named()[name] for name in header["members"]), records)


def _header(records: DistinctRecords) -> dict[str, str | int]:
    """Return the header of a family file for the given records and the present source code."""
    digest = hashlib.sha256(json.dumps(records.support.content()).encode())
    for values in (records.lead_speed, records.range_, records.closing_speed):
        digest.update(np.ascontiguousarray(values).tobytes())
    folders = Path(*smooth.__path__), Path(*candidates.__path__)
    sources = [*sorted(folders[0].glob("*.py")), *(folders[1] / name for name in SCORING)]
    shapes = [file for each in known().values() if each.adds_to("laws/smooth") for file in each.files]
    code = content_digest([*sources, *shapes])
    return {"format": FORMAT, "version": VERSION, "records": digest.hexdigest(), "code": code}


def _from_arrays(
    arrays: Mapping[str, Array], members: tuple[Member, ...], records: DistinctRecords
) -> SmoothFamily:
    fitter = Fitter(records, members)
    ranges, body = (
        _hazard(arrays, kind, grid) for kind, grid in zip(("ranges", "body"), fitter.grids, strict=True)
    )
    tails = {member: _excess(arrays, member) for member in members if member.level is not None}
    expected = {name: arrays[f"expected, {name}"] for name in DIVISIONS if f"expected, {name}" in arrays}
    return SmoothFamily(fitter, fitter.family_of(ranges, body, tails), arrays["scores"], expected)


def _hazard(arrays: Mapping[str, Array], kind: str, grid: HazardGrid) -> SmoothHazard:
    coefficients, smoothing, factor = (arrays[f"{kind} {name}"] for name in HAZARD)
    return SmoothHazard(grid, coefficients, tuple(smoothing.tolist()), factor)


def _excess(arrays: Mapping[str, Array], member: Member) -> Excess:
    coefficients, smoothing, factor, parameters = (arrays[f"tail {member.name}, {name}"] for name in EXCESS)
    return Excess(SHAPES[member.shape], coefficients, parameters, tuple(smoothing.tolist()), factor)
