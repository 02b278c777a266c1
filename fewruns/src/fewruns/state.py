"""The saved state of a sampler, from which it continues.

A state is JSON with the name of the format, its version, a checksum and the state itself. A state of another
version is not converted. The sampler is rebuilt from its runs instead, and everything else is learnt again.
"""

import json
import os
from collections import ChainMap
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import takewhile
from pathlib import Path
from types import MappingProxyType
from typing import Annotated, Any, get_type_hints

import numpy as np

from fewruns.arrays import Array
from fewruns.belief import Belief
from fewruns.certificate import Certificate
from fewruns.cover import Cover
from fewruns.errors import InputError
from fewruns.pools import space_along
from fewruns.problems import Predecessor
from fewruns.progress import SEARCH, Asked, PlainBatch, Progress
from fewruns.sampler import Sampler
from fewruns.typed_json import MISFIT, checksum, decode, encode

FORMAT, VERSION = "fewruns sampler", 7
RESTART = "Name the state of a sampler, or a path where there is no file yet, to begin a new run."

# What is kept of the progress of another version. Only the runs are required.
RUNS = ("z", "happened", "score")
KEPT = (*RUNS, "failed", "failed_draws", "law_draws", "repeats", "chance", "chance_since", "estimates")


@dataclass(frozen=True)
class State:
    """Everything that is needed to resume a sampler: the arguments of `Sampler`, and what it has learnt."""

    dimension: int
    batch_size: int
    fingerprint: str
    certificate: Certificate | Cover | None
    predecessor: Predecessor | None
    deterministic: bool | None
    enough_repeats: int
    enough_draws: int
    frequent: bool
    generator: dict  # state of the bit generator
    progress: Progress
    # Arrays of the surrogates; `EventSurrogate` and `GradedSurrogate` define them.
    axes: Annotated[Array, "coordinates", "coordinates"]
    theta: Annotated[Array, "lengths"]
    sites: Annotated[Array, 2, "sites"]
    graded_theta: Annotated[Array, "graded lengths"]


ARGUMENTS = tuple(takewhile("generator".__ne__, State.__dataclass_fields__))


def content_of(sampler: Sampler) -> dict[str, Any]:
    """Return the state of a sampler as dictionaries, lists and numbers, with a version and a checksum."""
    flags, theta = sampler.belief.flags, sampler.belief.scores.theta
    values = {name: getattr(sampler, name) for name in (*ARGUMENTS, "progress")}
    values |= {"axes": flags.axes, "theta": flags.theta, "sites": flags.sites, "graded_theta": theta}
    values["generator"] = sampler.generator.bit_generator.state
    state = encode(State(**values))
    return {"format": FORMAT, "version": VERSION, "checksum": checksum([VERSION, state]), "state": state}


def sampler_of(content: Any, where: str) -> Sampler:  # noqa: ANN401
    """Return the sampler whose state is in the content of a file; raise InputError if it is damaged.

    ``where`` is the path of the file, for the error.
    """
    if not isinstance(content, Mapping) or content.get("format") != FORMAT:
        expected = f"format {FORMAT!r}"
        raise InputError(where, seen="no state of a sampler", expected=expected, change=RESTART)
    damage = "a checksum that does not belong to the content, so the file is damaged"
    version, state = content.get("version"), content.get("state", {})
    if content.get("checksum") == checksum([version, state]):
        try:
            return _resumed(decode(State, state)) if version == VERSION else _rebuilt(state)
        except MISFIT as error:  # but the checksum is its own
            damage = f"a state that does not fit together ({type(error).__name__}: {error})"
    change = f"Restore the file from a copy. {RESTART}"
    raise InputError(where, seen=damage, expected="a file as the sampler wrote it", change=change)


def write_state(path: str | os.PathLike, sampler: Sampler) -> None:
    """Write the state of a sampler to a file.

    Parameters
    ----------
    path
        The file, which is replaced only when the new content is complete.
    sampler
        The sampler. A batch whose outcomes have not been received is part of the state.

    Examples
    --------
    >>> import tempfile
    >>> from pathlib import Path
    >>> import numpy as np
    >>> from fewruns import Sampler, read_state, write_state
    >>> sampler = Sampler(2, np.random.default_rng(1), fingerprint="half-plane")
    >>> z = sampler.ask()
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     write_state(Path(folder, "state.json"), sampler)
    ...     resumed = read_state(Path(folder, "state.json"))
    >>> bool((resumed.ask() == z).all())
    True
    """
    path = Path(path).resolve()
    temporary = path.with_name(f".{path.name}.{os.getpid()}")
    try:
        text = json.dumps(content_of(sampler), indent=2, allow_nan=False)
        temporary.write_text(text + "\n", encoding="utf-8")
        temporary.replace(path)
    finally:
        temporary.unlink(missing_ok=True)


def read_state(path: str | os.PathLike, **expected: Any) -> Sampler:  # noqa: ANN401
    """Return the sampler whose state is in a file; it continues as if it had not been interrupted.

    If another version of this package wrote the state, the sampler is rebuilt from its runs, and learns
    everything else again. The estimates of its batches are kept if they can be read.

    Parameters
    ----------
    path
        The file that `write_state` wrote.
    **expected
        Values that arguments of `Sampler` must have, for example ``fingerprint`` or ``batch_size``.

    Raises
    ------
    InputError
        If the file is not the state of a sampler, if it is damaged, or if an argument has another value.

    Examples
    --------
    >>> import tempfile
    >>> from pathlib import Path
    >>> import numpy as np
    >>> from fewruns import Sampler, read_state, write_state
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     write_state(Path(folder, "state.json"), Sampler(2, np.random.default_rng(1), batch_size=4))
    ...     resumed = read_state(Path(folder, "state.json"), batch_size=4)
    >>> resumed.ask().shape
    (4, 2)
    """
    try:
        content = json.loads(Path(path).read_text(encoding="utf-8"))
    except (ValueError, RecursionError):  # no text, no JSON, or JSON that is nested too deeply
        content = None
    sampler = sampler_of(content, str(path))
    for name, value in expected.items():
        if (seen := getattr(sampler, name)) != value:
            what = f"the {name.replace('_', ' ')} {seen!r}"
            raise InputError(str(path), seen=what, expected=repr(value), change=RESTART)
    return sampler


def _resumed(state: State) -> Sampler:
    """Return the sampler with a given state."""
    settings = {name: getattr(state, name) for name in ARGUMENTS}
    sampler = Sampler(generator=_generator_in(state.generator), **settings)
    progress = sampler.progress = state.progress
    space = space_along(progress.directions, state.dimension)
    sampler.belief = Belief(space, state.predecessor, noisy=progress.is_noisy)
    flags, scores = sampler.belief.flags, sampler.belief.scores
    shapes = flags.axes.shape, flags.theta.shape, scores.theta.shape
    if (read := (state.axes.shape, state.theta.shape, state.graded_theta.shape)) != shapes:
        raise ValueError(f"parameters of the shapes {read}, where {shapes} was expected")
    flags.axes, flags.theta, flags.sites = state.axes, state.theta, state.sites
    scores.theta = state.graded_theta
    return sampler


def _rebuilt(content: Mapping[str, Any]) -> Sampler:
    """Return a sampler with the arguments and the runs of a state of another version."""
    settings = _readable(State, content, ARGUMENTS, required=ARGUMENTS[:1])
    sampler = Sampler(generator=_generator_in(content["generator"]), **settings)
    known = _readable(Progress, content["progress"], KEPT, settings, required=RUNS)
    sampler.progress = replace(sampler.progress, **known)
    # The outcomes of the requested runs are outstanding. The new version will learn from them, but cannot use
    # them in its estimate, because it does not know their inclusion probabilities. Leaving the batches out
    # causes no bias, because this is decided before their outcomes are known.
    progress, pending = sampler.progress, content["progress"].get("pending")
    asked = content["progress"].get("asked", [{"batch": pending}] if pending is not None else [])
    for each in asked:
        known = _readable(PlainBatch, each["batch"], ("z",), settings, required=("z",))
        batch = PlainBatch(**known, phase=SEARCH)
        progress.asked.append(replace(Asked.start(batch, progress.next_number), issued=len(batch.z)))
    return sampler


def _readable(
    kind: type,
    content: Mapping[str, Any],
    names: Sequence[str],
    sizes: Mapping[str, Any] = MappingProxyType({}),
    *,
    required: Sequence[str],
) -> dict[str, Any]:
    """Return those fields of a dataclass that can be read; raise an error of `MISFIT` if one is required."""
    types, known = get_type_hints(kind, include_extras=True), ChainMap[str, Any]({}, dict(sizes))
    found: dict[str, Any] = {}
    for name in names:
        try:
            found[name] = decode(types[name], content[name], known)
        except MISFIT:
            if name in required:
                raise
    return found


def _generator_in(state: Mapping[str, Any]) -> np.random.Generator:
    """Return a generator whose bit generator has the given state."""
    bits = getattr(np.random, state["bit_generator"])()
    bits.state = state
    return np.random.Generator(bits)
