"""The file of a scored family of laws, so that a study fits it once."""

import hashlib
import json
import os
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from accelerated_evaluation import answer
from accelerated_evaluation.answer.calibration import DIVISIONS
from accelerated_evaluation.answer.smooth_family import SmoothFamily, named
from accelerated_evaluation.base.arrays import Array
from accelerated_evaluation.base.errors import InputError
from accelerated_evaluation.base.extensions import known
from accelerated_evaluation.base.files import atomic_path, content_digest, read_arrays
from accelerated_evaluation.laws import smooth
from accelerated_evaluation.laws.smooth.conditional import Places, Threshold
from accelerated_evaluation.laws.smooth.excess import Excess
from accelerated_evaluation.laws.smooth.family import (
    DistinctRecords,
    Exceedances,
    FarRecords,
    Fitter,
    LawFamily,
    Member,
)
from accelerated_evaluation.laws.smooth.far_tail import FarTail
from accelerated_evaluation.laws.smooth.shapes import SHAPES
from accelerated_evaluation.laws.smooth.smooth_hazard import HazardGrid, SmoothHazard

FORMAT = "accelerated-evaluation family"
VERSION = 3
HAZARD = ("coefficients", "smoothing", "factor")
EXCESS = (*HAZARD, "parameters")
FAR = ("levels", "log_factors")
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
    arrays = {"header": np.array(json.dumps(header)), "scores": scored.scores}
    arrays |= {f"expected, {name}": values for name, values in scored.expected.items()}
    for kind in ("ranges", "body"):
        arrays |= {f"{kind} {name}": getattr(getattr(family, kind), name) for name in HAZARD}
    if (few := family.far_records) is not None:
        table = few.places.lead_speed, few.places.range_, few.closing_speed
        columns = {"size": few.size, "lowest": few.lowest, "table": table}
        arrays |= {f"far records, {name}": np.array(value) for name, value in columns.items()}
    for level, threshold in family.thresholds.items():
        arrays[f"threshold {level!r}"] = threshold.table
    for member in scored.members:
        if member in family.tails:
            arrays |= {f"tail {member.name}, {name}": getattr(family.tails[member], name) for name in EXCESS}
        if member in family.far:
            arrays |= {f"far {member.name}, {name}": getattr(family.far[member], name) for name in FAR}
    with atomic_path(path) as temporary, temporary.open("wb") as file:
        np.savez(file, **arrays)


def read_family(path: str | os.PathLike, records: DistinctRecords) -> SmoothFamily:
    """Read a scored family from a file of `write_family`.

    InputError is raised if the file is missing or damaged, or was made for other records or by other code.
    """
    change = "Run the study, which fits the family of laws again."
    try:
        arrays = read_arrays(path)
        header = json.loads(str(arrays.pop("header")))
        differing = [key for key, value in _header(records).items() if header[key] != value]
        if differing:
            seen, expected = f"another value of {' and '.join(differing)}", "the family of these records"
            raise InputError(str(path), seen=seen, expected=expected, change=change)
        return _from_arrays(arrays, tuple(named()[name] for name in header["members"]), records)
    except (LookupError, OSError, TypeError, ValueError) as error:
        seen, expected = f"{type(error).__name__}: {error}", "a family file"
        raise InputError(str(path), seen=seen, expected=expected, change=change) from error


def _header(records: DistinctRecords) -> dict[str, str | int]:
    """Return the header of a family file for the given records and the present source code."""
    digest = hashlib.sha256(json.dumps(records.support.content()).encode())
    for values in (records.lead_speed, records.range_, records.closing_speed):
        digest.update(np.ascontiguousarray(values).tobytes())
    folders = Path(*smooth.__path__), Path(*answer.__path__)
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
    nodes = fitter.grids[1].edges[:2]
    levels = [float(key.split()[1]) for key in arrays if key.startswith("threshold")]
    thresholds = {level: Threshold(level, *nodes, arrays[f"threshold {level!r}"]) for level in levels}
    tails = {member: _excess(arrays, member) for member in members if member.level is not None}
    used = dict.fromkeys(member.level for member in tails)
    exceedances = {level: Exceedances.of(records, thresholds[level]) for level in sorted(used)}
    far = {
        member: FarTail(*(arrays[f"far {member.name}, {name}"] for name in FAR))
        for member in members
        if f"far {member.name}, {FAR[0]}" in arrays
    }
    few = None
    if far:
        size, lowest, table = (arrays[f"far records, {name}"] for name in ("size", "lowest", "table"))
        places = Places.of(*table[:2], records.support)
        few = FarRecords(places, table[2], int(size), float(lowest), records.support)
    family = LawFamily(ranges, body, thresholds, exceedances, tails, far, few)
    expected = {name: arrays[f"expected, {name}"] for name in DIVISIONS if f"expected, {name}" in arrays}
    return SmoothFamily(fitter, family, arrays["scores"], expected)


def _hazard(arrays: Mapping[str, Array], kind: str, grid: HazardGrid) -> SmoothHazard:
    coefficients, smoothing, factor = (arrays[f"{kind} {name}"] for name in HAZARD)
    return SmoothHazard(grid, coefficients, tuple(smoothing.tolist()), factor)


def _excess(arrays: Mapping[str, Array], member: Member) -> Excess:
    coefficients, smoothing, factor, parameters = (arrays[f"tail {member.name}, {name}"] for name in EXCESS)
    return Excess(SHAPES[member.shape], coefficients, parameters, tuple(smoothing.tolist()), factor)
