"""The file of a campaign, readable JSON."""

import fcntl
import json
import os
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from fewruns.state import content_of, sampler_of
from fewruns.typed_json import MISFIT, checksum, decode, encode

from accelerated_evaluation.base.errors import InputError, located
from accelerated_evaluation.base.files import read_json, write_text
from accelerated_evaluation.base.tables import require_file
from accelerated_evaluation.laws import Law
from accelerated_evaluation.methods import Stopping, study_errors
from accelerated_evaluation.scenarios import SCENARIOS
from accelerated_evaluation.track.campaign import Campaign, Run
from accelerated_evaluation.track.law_files import InputFile, law_in, source_of
from accelerated_evaluation.track.limits import Limits

FORMAT, VERSION = "accelerated-evaluation campaign", 1
RESTORE = "Restore a copy of the file; report outcomes from the track with `campaign tell`."


@dataclass(frozen=True)
class Content:
    """The content of the file: the fields of `Campaign`, with the sampler as `fewruns` saves it."""

    scenario: str  # name
    law: InputFile
    encounters: InputFile | None
    description: str
    quantity: str  # of the event
    threshold: float
    goal: Stopping
    limits: Limits
    beyond: float
    runs: list[Run]
    sampler: dict


@contextmanager
def locked(path: str | os.PathLike) -> Iterator[None]:
    """Lock the campaigns of a folder for the duration of a ``with`` block.

    If two processes read a campaign, add to it and write it at the same time, the additions of one of them
    are lost. The folder is locked and not the file, because the file is replaced whenever it is written.
    """
    folder = Path(path).resolve().parent
    if not folder.is_dir():  # reading the file will raise an error
        yield
        return
    handle = os.open(folder, os.O_RDONLY)
    try:
        fcntl.flock(handle, fcntl.LOCK_EX)
        yield
    finally:
        os.close(handle)


def law_of(campaign: Campaign) -> Law:
    """Return the law of a campaign, read from its law file.

    InputError is raised if the law file or the encounter table is missing, or has changed since the campaign
    began.
    """
    for source in (campaign.law, campaign.encounters):
        if source is not None and source_of(source.file) != source:
            raise InputError(
                source.file,
                seen="a file that has changed since the campaign began",
                expected=f"the file with the SHA-256 checksum {source.sha256[:12]}...",
                change="Restore the file, because the runs were chosen for its law. "
                "For another law, begin another campaign.",
            )
    return law_in(campaign.scenario, campaign.law, campaign.encounters)


def write_campaign(path: str | os.PathLike, campaign: Campaign) -> None:
    """Write a campaign to its file, atomically."""
    content = Content(
        campaign.scenario.name,
        campaign.law,
        campaign.encounters,
        campaign.description,
        campaign.event.quantity,
        campaign.event.threshold,
        campaign.goal,
        campaign.limits,
        campaign.beyond,
        campaign.runs,
        content_of(campaign.sampler),
    )
    plain = encode(content)
    head = {"format": FORMAT, "version": VERSION, "checksum": checksum(plain)}
    write_text(path, _laid_out(head | plain) + "\n")


def read_campaign(path: str | os.PathLike) -> Campaign:
    """Read a campaign from its file.

    InputError is raised if the file is missing, is not a campaign, is of another version, or was edited or
    damaged.
    """
    change = "Name the file of a campaign, or begin one with `accelerated-evaluation campaign new`."
    require_file(path, change)
    try:
        plain = read_json(path)
    except ValueError:
        plain = None
    if not isinstance(plain, Mapping) or plain.get("format") != FORMAT:
        raise InputError(str(path), seen="no campaign", expected=f"format {FORMAT!r}", change=change)
    head = {name: plain.pop(name, None) for name in ("format", "version", "checksum")}
    if json.dumps(head["version"]) != str(VERSION):  # true is equal to 1
        seen = f"version {json.dumps(head['version'])}"
        change = "Continue with the version of the program that wrote the file."
        raise InputError(str(path), seen=seen, expected=f"version {VERSION}", change=change)
    damage = "a checksum that does not agree with the content"
    if head["checksum"] == checksum(plain):
        try:
            with located(str(path)), study_errors():
                return _campaign(decode(Content, plain))
        except MISFIT as error:  # but the checksum is its own
            damage = f"contents that are not a valid campaign ({type(error).__name__}: {error})"
    raise InputError(str(path), seen=damage, expected="a file as the program wrote it", change=RESTORE)


def _campaign(content: Content) -> Campaign:
    """Return the campaign from the content of its file."""
    scenario = SCENARIOS[content.scenario]
    return Campaign(
        content.law,
        content.encounters,
        content.description,
        scenario.event(content.quantity, content.threshold),
        content.goal,
        sampler_of(content.sampler, "its sampler"),
        content.limits,
        content.beyond,
        content.runs,
        scenario=scenario,
    )


def stopping(confidence: float, relative_half_width: float, *, anytime: bool) -> Stopping:
    """Return the goal of a campaign as a stopping rule, from the level and the half-width of the interval."""
    return Stopping(round(1 - confidence, 12), relative_half_width, minimum_events=1, anytime=anytime)


def _laid_out(value: Any, margin: str = "") -> str:  # noqa: ANN401
    """Return a value as JSON, with a line for each member of an object and for each item of a nested list."""
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
