"""The file of a campaign: readable JSON, from which later versions of the sampler can continue."""

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
from fewruns import state as sampler_state
from fewruns.progress import ApproachBatch
from fewruns.sampler import Sampler
from fewruns.state_json import MISFIT, decode

from accelerated_evaluation.base.errors import InputError
from accelerated_evaluation.base.files import read_json, write_text
from accelerated_evaluation.base.tables import require_file
from accelerated_evaluation.laws import Law
from accelerated_evaluation.laws.joint import JointLaw
from accelerated_evaluation.methods.estimate import Stopping
from accelerated_evaluation.methods.surrogate import study_errors
from accelerated_evaluation.scenarios import SCENARIOS
from accelerated_evaluation.scenarios.cut_in import CUT_IN
from accelerated_evaluation.scenarios.protocol import Scenario
from accelerated_evaluation.track.campaign import Campaign, Run, sampler_rules
from accelerated_evaluation.track.driven import DrivenOutcome
from accelerated_evaluation.track.limits import UNLIMITED, Limits
from accelerated_evaluation.track.sources import Source, law_in, source_of

FORMAT, VERSION = "accelerated-evaluation campaign", 2
READABLE = (1, VERSION)  # campaigns of version 1 have no limits
RESTORE = "Restore a copy of the file; report outcomes from the track with `campaign tell`."


@contextmanager
def locked(path: str | os.PathLike) -> Iterator[None]:
    """Lock the campaigns of a folder for the duration of a ``with`` block.

    If two processes read a campaign, add to it and write it at the same time, the additions of one of them
    are lost. The folder is locked and not the file, because the file is replaced whenever it is written.

    Parameters
    ----------
    path
        File of a campaign.
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


def law_of(campaign: Campaign) -> Law | JointLaw:
    """Return the law of a campaign, read from its law file.

    Raises
    ------
    InputError
        If the law file or the encounter table is missing, or has changed since the campaign began.
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
    return law_in(campaign.scenario, campaign.law, campaign.encounters)[0]


def write_campaign(path: str | os.PathLike, campaign: Campaign) -> None:
    """Write a campaign to its file, atomically."""
    # The file of a campaign of cut-ins has no scenario, as in earlier versions.
    scenario = {} if campaign.scenario is CUT_IN else {"scenario": campaign.scenario.name}
    content = scenario | {
        "law": asdict(campaign.law),
        "encounters": None if campaign.encounters is None else asdict(campaign.encounters),
        "description": campaign.description,
        "event": {"quantity": campaign.event.quantity, "threshold": campaign.event.threshold},
        "goal": {"confidence": 1 - campaign.goal.alpha, "relative_half_width": campaign.goal.beta},
        "interval": "anytime" if campaign.goal.anytime else "usual",
        "limits": asdict(campaign.limits) | {"probability_beyond": campaign.beyond},
        "runs": [_plain(run, campaign.scenario) for run in campaign.runs],
        "sampler": campaign.sampler.state().to_json(),
    }
    head = {"format": FORMAT, "version": VERSION, "checksum": _checksum(content)}
    write_text(path, _laid_out(head | content) + "\n")


def read_campaign(path: str | os.PathLike) -> Campaign:
    """Read a campaign from its file.

    Raises
    ------
    InputError
        If the file is missing, is not a campaign, is of an unknown version, or was edited or damaged.
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
        change = "Continue with the version of the program that wrote the file, or with a later one."
        raise InputError(str(path), seen=seen, expected=f"version {VERSION}", change=change)
    if head["checksum"] != _checksum(content):
        raise InputError(
            str(path),
            seen="a checksum that does not agree with the content",
            expected="a file as the program wrote it",
            change=RESTORE,
        )
    try:
        with study_errors():
            return _campaign(content, str(path))
    except MISFIT as error:  # but the checksum is its own
        raise InputError(
            str(path),
            seen=f"contents that are not a valid campaign ({type(error).__name__}: {error})",
            expected="a file as the program wrote it",
            change=RESTORE,
        ) from error


def _campaign(content: Mapping[str, Any], where: str) -> Campaign:
    """Return the campaign from the contents of a file; raise an error of `MISFIT` if they are not valid."""
    goal = decode(dict[str, float], content["goal"])
    limits = {"probability_beyond": 0.0} | decode(dict[str, Any], content.get("limits", {}))
    beyond = decode(float, limits.pop("probability_beyond"))
    scenario = SCENARIOS[content.get("scenario", CUT_IN.name)]
    threshold = decode(float, content["event"]["threshold"])
    event = scenario.event(content["event"]["quantity"], threshold)
    campaign = Campaign(
        decode(Source, content["law"]),
        decode(Source | None, content["encounters"]),
        decode(str, content["description"]),
        event,
        stopping(**goal, anytime=content.get("interval", "usual") == "anytime"),
        _sampler(content["sampler"], where, sampler_rules(scenario, event)),
        decode(Limits, asdict(UNLIMITED) | limits),
        beyond,
        [_run(run, scenario) for run in content["runs"]],
        scenario,
    )
    _require_whole(campaign)
    return campaign


def _require_whole(campaign: Campaign) -> None:
    """Raise ValueError if the parts of a campaign contradict each other."""
    numbers = [0, *(run.batch for run in campaign.runs)]
    measured = [value for run in campaign.runs if run.outcome for value in run.outcome.measured.values()]
    pending = campaign.sampler.progress.pending
    open_batch = (
        [run for run in campaign.runs if run.batch == campaign.batches] if campaign.outstanding else []
    )
    for holds, what in (
        (0 < campaign.goal.alpha < 1 and 0 < campaign.goal.beta < 1, "a goal between 0 and 1"),
        (0 <= campaign.beyond <= 1, "a probability beyond the limits from 0 to 1"),
        (all(value is None or value > 0 for value in vars(campaign.limits).values()), "limits above 0"),
        (campaign.sampler.dimension == campaign.scenario.dimension, "a normal score for each variable"),
        ((campaign.encounters is None) == (campaign.scenario is not CUT_IN), "a table for cut-ins alone"),
        (
            [run.number for run in campaign.runs] == [*range(1, len(campaign.runs) + 1)],
            "runs that are numbered from 1",
        ),
        (set(np.diff(numbers)) <= {0, 1}, "runs in the order of their batches"),
        (np.isfinite([run.encounter for run in campaign.runs]).all(), "encounters of finite numbers"),
        (np.isfinite(measured).all(), "outcomes of finite numbers"),
        (len(open_batch) == (0 if pending is None else len(pending.z)), "one open batch, the sampler's"),
        (
            campaign.sampler.simulations + len(open_batch) == len(campaign.runs),
            "as many runs as the sampler knows",
        ),
    ):
        if not holds:
            raise ValueError(f"without {what}")


def stopping(confidence: float, relative_half_width: float, *, anytime: bool) -> Stopping:
    """Return the goal of a campaign as a stopping rule.

    Parameters
    ----------
    confidence
        Confidence level of the interval, between 0 and 1.
    relative_half_width
        Required half-width of the interval, divided by the estimate.
    anytime
        Whether the intervals keep their level although they are checked after every batch.
    """
    return Stopping(round(1 - confidence, 12), relative_half_width, minimum_events=1, anytime=anytime)


def _plain(run: Run, scenario: Scenario) -> dict[str, Any]:
    """Return a run as a dictionary for the file; quantities that were not measured are left out."""
    outcome = None
    if run.outcome is not None:
        note = {"note": run.outcome.note} if run.outcome.note else {}
        outcome = {"crash": run.outcome.crash, **run.outcome.measured, **note}
    encounter = zip(scenario.names, run.encounter, strict=True)
    return {"number": run.number, "batch": run.batch, **dict(encounter), "outcome": outcome}


def _run(plain: Mapping[str, Any], scenario: Scenario) -> Run:
    """Return the run that `_plain` converted to a dictionary."""
    outcome = None
    encounter = tuple(decode(float, plain[name]) for name in scenario.names)
    if plain["outcome"] is not None:
        own = dict(plain["outcome"])
        crash, note = decode(bool, own.pop("crash")), decode(str, own.pop("note", ""))
        if unknown := own.keys() - set(scenario.measured):
            raise ValueError(f"outcomes {', '.join(sorted(unknown))}")
        outcome = DrivenOutcome(crash, {name: decode(float, value) for name, value in own.items()}, note)
    return Run(decode(int, plain["number"]), decode(int, plain["batch"]), encounter, outcome)


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


def _checksum(content: Mapping[str, Any]) -> str:
    """Return a digest that does not depend on the layout of the file."""
    text = json.dumps(content, sort_keys=True, separators=(",", ":"))
    return hashlib.sha256(text.encode()).hexdigest()


def _sampler(content: Mapping[str, Any], where: str, rules: Mapping[str, Any]) -> Sampler:
    """Return the sampler; if another version of the sampler wrote the state, it is rebuilt from its runs."""
    if content.get("version") == sampler_state.VERSION:
        return Sampler.resume(sampler_state.State.from_json(content, where), **rules)
    old = content["state"]
    progress = _carried_over(old["progress"], old["dimension"])
    if (pending := old["progress"]["pending"]) is not None:
        # The outcomes of these runs are outstanding. The new version will learn from them, but cannot use
        # them in its estimate, because it does not know their inclusion probabilities. Leaving the batch out
        # causes no bias, because this is decided before its outcomes are known.
        progress.pending = ApproachBatch(np.array(pending["z"]))
    generator = sampler_state.generator_in(old["generator"])
    sampler = Sampler(old["dimension"], generator, old["batch_size"], fingerprint=old["fingerprint"])
    sampler.progress = progress
    # The rebuilt state is checked in the same way as a state of this version.
    return Sampler.resume(sampler_state.State.from_json(sampler.state().to_json(), where), **rules)


def _carried_over(old: Mapping[str, Any], dimension: int) -> sampler_state.Progress:
    """Return the runs from the state of another version, and its batch estimates if they can be read.

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
