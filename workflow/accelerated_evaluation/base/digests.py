"""Digests: of the contents of files, and of values that JSON can hold."""

import hashlib
import json
import os
from collections.abc import Iterable
from pathlib import Path
from typing import Any


def content_digest(paths: Iterable[str | os.PathLike], missing: str = "") -> str:
    """Return a digest of the contents of files, in their order; their names and dates do not count.

    Parameters
    ----------
    paths
        The files.
    missing
        Stands for the SHA-256 of a file that does not exist, such as one that is still to be retrieved. The
        rule that needs the file as an input says that it is missing.
    """
    files = [Path(path) for path in paths]
    return value_digest([file_digest(file) if file.is_file() else missing for file in files])


def file_digest(path: Path) -> str:
    """Return the SHA-256 of a file, which may be larger than the memory."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def value_digest(value: Any) -> str:  # noqa: ANN401
    """Return a digest of a value that JSON can hold; the order of the keys of its mappings does not count."""
    return hashlib.sha256(json.dumps(value, sort_keys=True).encode()).hexdigest()
