"""A configuration whose limits that are ``auto`` get values from the records, read once for a study."""

from collections.abc import Mapping, Sequence
from contextlib import suppress
from copy import deepcopy
from functools import reduce
from operator import getitem
from pathlib import Path
from typing import Any

from accelerated_evaluation.base.files import content_digest, read_json, value_digest, write_json
from accelerated_evaluation.base.randomness import child_generator
from accelerated_evaluation.records import limits
from accelerated_evaluation.records.limits import AUTO, AUTOMATIC
from accelerated_evaluation.records.sources import read_source


def value_of(config: Mapping[str, Any], key: str) -> Any:  # noqa: ANN401
    """Return the value of a key such as ``filters.range_max`` in a configuration."""
    return reduce(getitem, key.split("."), config)


def with_values(config: Mapping[str, Any], values: Mapping[str, Any]) -> dict[str, Any]:
    """Return a copy of a configuration with the given values for keys such as ``filters.range_max``."""
    changed = deepcopy(dict(config))
    for key, value in values.items():
        *sections, name = key.split(".")
        reduce(getitem, sections, changed)[name] = value
    return changed


def with_limits(
    config: Mapping[str, Any],
    files: Sequence[str] = (),
    kept: Path | None = None,
    *,
    trust: bool = False,
) -> dict[str, Any]:
    """Return a configuration in which each ``auto`` is replaced by a value.

    The limits are saved in ``kept``, so that the records are read only once; they are reused only if the
    contents of ``files`` are unchanged. With ``trust`` they are used without this check. The jobs of a run do
    so, because the run has already checked the limits. InputError is raised if the records cannot be read, if
    no row has three valid numbers, or if no lead speed is within the stated limits.
    """
    asked = [key for key in AUTOMATIC if value_of(config, key) == AUTO]
    if not asked:
        return dict(config)
    stated = {key: value_of(config, key) for key in AUTOMATIC}
    has_kept = kept is not None and kept.is_file()
    if has_kept and trust:
        return with_values(config, read_json(kept)["limits"])
    of = value_digest([config["data"], config["seed"], stated, content_digest([*files, limits.__file__])])
    found = None
    with suppress(ValueError):  # a damaged file is written again
        found = read_json(kept) if has_kept else None
    if not isinstance(found, Mapping) or found.get("of") != of or found != _kept(of, found.get("limits")):
        raw = read_source(config["data"], child_generator(config["seed"], "sample"))
        derived = limits.limits_of(raw, stated, config["data"])
        found = _kept(of, {key: derived[key] for key in asked})
        if kept is not None:
            write_json(kept, found)
    return with_values(config, found["limits"])


def _kept(of: str, values: object) -> dict[str, Any]:
    """Return the content of the file of limits.

    It has the limits, the digest ``of`` of the settings and files to which they belong, and a checksum that
    detects changes by hand.
    """
    return {"of": of, "limits": values, "checksum": value_digest([of, values])}
