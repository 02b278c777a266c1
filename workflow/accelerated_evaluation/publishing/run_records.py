"""Snakemake's records of a study: for each file the job that made it, its inputs and the time."""

import os
import re
from ast import literal_eval
from base64 import urlsafe_b64encode
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from accelerated_evaluation.base.errors import InputError
from accelerated_evaluation.base.files import file_digest, read_json
from accelerated_evaluation.study.dependencies import JOBS, LIBRARY, digest_of

RECORDS = Path(".snakemake/metadata")
NAME_LENGTH = 254  # largest length of a file name; Snakemake divides the longer name of a record into folders


@dataclass
class Job:
    """A job that ran, as Snakemake recorded it."""

    rule: str  # name of the Snakemake rule
    script: str  # path of its script, ``workflow/scripts/...``; empty if the rule has none
    logs: tuple[str, ...]
    inputs: tuple[str, ...]
    outputs: list[str]
    checksums: Mapping[str, str]  # ``"sha256:..."`` of each input when the job read it, by path
    # Digests of the code of the library that the job may have run, by package (`study.dependencies`).
    code: Mapping[str, str]
    started: datetime  # UTC
    ended: datetime  # UTC


def jobs_of(folders: Iterable[Path]) -> list[Job]:
    """Return all jobs that contributed to the files in some folders, in the order of their start.

    These are the jobs that wrote the files, and those that wrote the inputs of these jobs, and so on. Files
    without a record, such as logs, are ignored. InputError is raised if nothing was recorded, or a recorded
    output does not exist.
    """
    waiting = [str(path) for folder in folders for path in sorted(folder.rglob("*")) if path.is_file()]
    seen: set[str] = set()
    jobs: dict[tuple[str, ...], Job] = {}
    while waiting:
        path = waiting.pop()
        if path in seen:
            continue
        seen.add(path)
        record = _record(path)
        if record is None:
            continue
        key = (record["rule"], *record["log"])
        if key not in jobs:
            jobs[key] = _job(record)
            waiting += jobs[key].inputs
        jobs[key].outputs.append(path)
    if not jobs:
        raise InputError(
            str(RECORDS),
            seen="no record of a job of this study",
            expected="records that Snakemake wrote when it ran the study in this folder",
            change="Run the study here, and without --drop-metadata.",
        )
    for job in jobs.values():
        job.outputs.sort()
    return sorted(jobs.values(), key=lambda job: (job.started, job.rule, job.logs))


def require_unchanged(jobs: Iterable[Job]) -> None:
    """Raise InputError with the first file or package of the library that has changed since a job used it."""
    now: dict[str, str] = {}
    for job in jobs:
        for room, recorded in job.code.items():
            if (digest := digest_of(room)) != recorded:
                raise InputError(
                    f"{LIBRARY.name}/{room}",
                    seen=f"code with the digest {digest}",
                    expected=f"{recorded}, as when the rule {job.rule} ran",
                    change="Run the study again, so that its results come from this code.",
                )
        for path, recorded in job.checksums.items():
            if path not in now:
                now[path] = f"sha256:{file_digest(Path(path))}" if Path(path).is_file() else "no such file"
            if now[path] != recorded:
                raise InputError(
                    path,
                    seen=now[path],
                    expected=f"{recorded}, as when the rule {job.rule} read it",
                    change="Run the study again, so that its results come from these files.",
                )


def _record(path: str) -> dict[str, Any] | None:
    """Return Snakemake's record of the job that wrote a file; None if there is none, or it is incomplete.

    The name of the record is the path of the file in Base64.
    """
    name = urlsafe_b64encode(os.fsencode(path)).decode()
    parts = [name[start : start + NAME_LENGTH] for start in range(0, len(name), NAME_LENGTH)]
    note = RECORDS.joinpath(*(f"@{part}" for part in parts[:-1]), parts[-1])
    record = read_json(note) if note.is_file() else None
    return None if record is None or record.get("incomplete") else record


def _job(record: Mapping[str, Any]) -> Job:
    """Return the job of a record, without outputs, which the caller adds: each output has its own record."""
    scripts = re.findall(r"scripts/(\w+\.py)", record["code"] or "")
    return Job(
        rule=record["rule"],
        script=f"workflow/scripts/{scripts[0]}" if scripts else "",
        logs=tuple(record["log"]),
        # Folders, such as the book, are left out, because the crate lists files.
        inputs=tuple(path for path in record["input"] if not Path(path).is_dir()),
        outputs=[],
        checksums=record["input_checksums"],
        code=next(
            map(literal_eval, (text for text in record["params"] if text.startswith(f"{{'{JOBS}'"))), {}
        ),
        started=datetime.fromtimestamp(record["starttime"], UTC),
        ended=datetime.fromtimestamp(record["endtime"], UTC),
    )
