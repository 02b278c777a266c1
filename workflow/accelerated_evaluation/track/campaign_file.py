"""The file of a campaign: readable JSON that later versions of the sampler can still use."""

import fcntl
import hashlib
import json
import os
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any, get_type_hints

import numpy as np

from accelerated_evaluation.base.digests import file_digest
from accelerated_evaluation.base.errors import InputError
from accelerated_evaluation.base.files import read_json, write_text
from accelerated_evaluation.base.tables import require_file
from accelerated_evaluation.laws import Law
from accelerated_evaluation.laws.files import read_law
from accelerated_evaluation.methods.estimate import Stopping
from accelerated_evaluation.methods.surrogate import state as sampler_state
from accelerated_evaluation.methods.surrogate.progress import ApproachBatch
from accelerated_evaluation.methods.surrogate.sampler import Sampler
from accelerated_evaluation.methods.surrogate.state_json import MISFIT, decode
from accelerated_evaluation.records.encounter_table import read_encounters
from accelerated_evaluation.track.campaign import Campaign, Run, Source
from accelerated_evaluation.track.driven import DrivenOutcome
from accelerated_evaluation.track.limits import UNLIMITED, Limits
from accelerated_evaluation.vehicles.events import Event

FORMAT, VERSION = "accelerated-evaluation campaign", 2
READABLE = (1, VERSION)  # campaigns of version 1 have no limits
RESTORE = "Restore a copy of the file; report outcomes from the track with `campaign tell`."
CUT_IN = {"range_": "range"}  # attributes of a run that have another name in the file


def source_of(path: str | os.PathLike) -> Source:
    """Return a file with its checksum; raise InputError if it does not exist."""
    path = Path(path)
    require_file(path, "Correct its path.")
    return Source(str(path), file_digest(path))


@contextmanager
def locked(path: str | os.PathLike) -> Iterator[None]:
    """Let no other process read and write the campaigns of this folder during the block.

    If two processes read a campaign, add to it and write it at once, what one of them added is lost. The lock
    is that of the folder, because the file is replaced whenever it is written.
    """
    folder = Path(path).resolve().parent
    if not folder.is_dir():  # the error is that of reading the file
        yield
        return
    handle = os.open(folder, os.O_RDONLY)
    try:
        fcntl.flock(handle, fcntl.LOCK_EX)
        yield
    finally:
        os.close(handle)


def law_of(campaign: Campaign) -> Law:
    """Read the law of a campaign.

    Raises
    ------
    InputError
        If the law file or the encounter table is missing, or has changed since the campaign began.
    """
    for source in (campaign.law, campaign.encounters):
        if source_of(source.file) != source:
            raise InputError(
                source.file,
                seen="another content than when the campaign began",
                expected=f"the file with the SHA-256 checksum {source.sha256[:12]}...",
                change="Restore the file: the runs were chosen for the law as it was. "
                "For another law begin another campaign.",
            )
    return read_law(campaign.law.file, read_encounters(campaign.encounters.file))


def write_campaign(path: str | os.PathLike, campaign: Campaign) -> None:
    """Write a campaign, atomically; `read_campaign` reads it."""
    content = {
        "law": asdict(campaign.law),
        "encounters": asdict(campaign.encounters),
        "description": campaign.description,
        "event": asdict(campaign.event),
        "goal": {"confidence": 1 - campaign.goal.alpha, "relative_half_width": campaign.goal.beta},
        "interval": "anytime" if campaign.goal.anytime else "usual",
        "limits": asdict(campaign.limits) | {"probability_beyond": campaign.beyond},
        "runs": [_plain(run) for run in campaign.runs],
        "sampler": campaign.sampler.state().to_json(),
    }
    head = {"format": FORMAT, "version": VERSION, "checksum": _checksum(content)}
    write_text(path, _laid_out(head | content) + "\n")


def read_campaign(path: str | os.PathLike) -> Campaign:
    """Read a campaign.

    Raises
    ------
    InputError
        If the file is missing, is not a campaign of this version, or was edited or damaged.
    """
    change = "Name the file of a campaign, or begin one with `accelerated-evaluation campaign new`."
    require_file(path, change)
    try:
        content = read_json(path)
    except ValueError:
        content = None
    if not isinstance(content, Mapping) or content.get("format") != FORMAT:
        raise InputError(str(path), seen="no campaign", expected=f"format {FORMAT!r}", change=change)
    head = {name: content.pop(name, None) for name in ("format", "version", "checksum")}
    if head["version"] not in READABLE:
        seen = f"version {head['version']}"
        change = "Go on with the version of the program that wrote it, or a later one."
        raise InputError(str(path), seen=seen, expected=f"version {VERSION}", change=change)
    if head["checksum"] != _checksum(content):
        raise InputError(
            str(path),
            seen="a checksum that does not belong to the content",
            expected="a file as the program wrote it",
            change=RESTORE,
        )
    try:
        return _campaign(content, str(path))
    except MISFIT as error:  # but the checksum is its own
        raise InputError(
            str(path),
            seen=f"a content that does not fit together ({type(error).__name__}: {error})",
            expected="a file as the program wrote it",
            change=RESTORE,
        ) from error


def _campaign(content: Mapping[str, Any], where: str) -> Campaign:
    """Return the campaign that a content holds; raise one of `MISFIT` if it holds none."""
    goal = decode(dict[str, float], content["goal"])
    limits = {"probability_beyond": 0.0} | decode(dict[str, Any], content.get("limits", {}))
    beyond = decode(float, limits.pop("probability_beyond"))
    campaign = Campaign(
        decode(Source, content["law"]),
        decode(Source, content["encounters"]),
        decode(str, content["description"]),
        decode(Event, content["event"]),
        stopping(**goal, anytime=content.get("interval", "usual") == "anytime"),
        _sampler(content["sampler"], where),
        decode(Limits, asdict(UNLIMITED) | limits),
        beyond,
        [_run(run) for run in content["runs"]],
    )
    _require_whole(campaign)
    return campaign


def _require_whole(campaign: Campaign) -> None:
    """Raise ValueError if the parts of a campaign contradict each other."""
    numbers = [0, *(run.batch for run in campaign.runs)]
    pending = campaign.sampler.progress.pending
    open_batch = (
        [run for run in campaign.runs if run.batch == campaign.batches] if campaign.outstanding else []
    )
    for holds, what in (
        (0 < campaign.goal.alpha < 1 and 0 < campaign.goal.beta < 1, "a goal between 0 and 1"),
        (0 <= campaign.beyond <= 1, "a probability beyond the limits from 0 to 1"),
        (all(value is None or value > 0 for value in vars(campaign.limits).values()), "limits above 0"),
        (
            campaign.event.quantity in ("crash", "impact_speed", "min_range", "min_ttc"),
            "an event that is measured",
        ),
        (campaign.sampler.dimension == 3, "a sampler of three normal scores"),
        (
            [run.number for run in campaign.runs] == [*range(1, len(campaign.runs) + 1)],
            "runs that are numbered from 1",
        ),
        (set(np.diff(numbers)) <= {0, 1}, "runs in the order of their batches"),
        (len(open_batch) == (0 if pending is None else len(pending.z)), "one open batch, the sampler's"),
        (
            campaign.sampler.simulations + len(open_batch) == len(campaign.runs),
            "as many runs as the sampler knows",
        ),
    ):
        if not holds:
            raise ValueError(f"without {what}")


def stopping(confidence: float, relative_half_width: float, *, anytime: bool) -> Stopping:
    """Return the goal of a campaign as a stopping rule without a limit on the number of runs."""
    return Stopping(round(1 - confidence, 12), relative_half_width, minimum_events=1, anytime=anytime)


def _plain(run: Run) -> dict[str, Any]:
    """Return a run as the file has it."""
    plain = {CUT_IN.get(name, name): value for name, value in vars(run).items()}
    if run.outcome is not None:
        plain["outcome"] = {
            name: value for name, value in vars(run.outcome).items() if value not in (None, "")
        }
    return plain


def _run(plain: Mapping[str, Any]) -> Run:
    """Return a run from what the file has."""
    own = {name: plain[CUT_IN.get(name, name)] for name in get_type_hints(Run)}
    if own["outcome"] is not None:  # what was not measured is left out of the file
        own["outcome"] = vars(DrivenOutcome(crash=False)) | own["outcome"]
    return decode(Run, own)


def _laid_out(value: Any, margin: str = "") -> str:  # noqa: ANN401
    """Return JSON with a line for each member of an object, and for each run, point and batch of a list."""
    if isinstance(value, Mapping):
        members = [f"{json.dumps(name)}: {_laid_out(item, margin + ' ')}" for name, item in value.items()]
        return _on_lines("{}", members, margin)
    if isinstance(value, list) and any(isinstance(item, list | Mapping) for item in value):
        return _on_lines(
            "[]", [json.dumps(item, ensure_ascii=False, allow_nan=False) for item in value], margin
        )
    return json.dumps(value, ensure_ascii=False, allow_nan=False)


def _on_lines(brackets: str, items: list[str], margin: str) -> str:
    if not items:
        return brackets
    return brackets[0] + ",".join(f"\n{margin} {item}" for item in items) + f"\n{margin}{brackets[1]}"


def _checksum(content: Mapping[str, Any]) -> str:
    """Return a digest that does not depend on how the file is laid out."""
    text = json.dumps(content, sort_keys=True, separators=(",", ":"))
    return hashlib.sha256(text.encode()).hexdigest()


def _sampler(content: Mapping[str, Any], where: str) -> Sampler:
    """Return the sampler; if another version of it wrote the state, it is rebuilt from its runs."""
    if content.get("version") == sampler_state.VERSION:
        return Sampler.resume(sampler_state.State.from_json(content, where))
    old = content["state"]
    progress = _carried_over(old["progress"], old["dimension"])
    if (pending := old["progress"]["pending"]) is not None:
        # These runs are on their way. They will teach the new version, which cannot weigh what it did not
        # choose. To leave their batch out does no harm: that was decided before its outcomes were known.
        progress.pending = ApproachBatch(np.array(pending["z"]))
    generator = sampler_state.generator_in(old["generator"])
    sampler = Sampler(old["dimension"], generator, old["batch_size"], fingerprint=old["fingerprint"])
    sampler.progress = progress
    # What was carried over is checked as a state of this version is.
    return Sampler.resume(sampler_state.State.from_json(sampler.state().to_json(), where))


def _carried_over(old: Mapping[str, Any], dimension: int) -> sampler_state.Progress:
    """Return the runs of another version, and of its batch estimates what this one understands.

    Everything else is left out, because the surrogate can be learnt again from the runs.
    """
    types = get_type_hints(sampler_state.Progress)
    try:
        estimates = decode(types["estimates"], old["estimates"])
    except MISFIT:
        estimates = []
    progress = sampler_state.Progress.start(dimension)
    z, flags, scores = (decode(types[name], old[name]) for name in ("z", "happened", "score"))
    return replace(progress, z=z.reshape(-1, dimension), happened=flags, score=scores, estimates=estimates)
