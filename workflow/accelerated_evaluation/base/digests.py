"""Digests (checksums) of the contents of files, and of values that can be written as JSON."""

import hashlib
import json
import os
import re
from collections.abc import Iterable
from pathlib import Path
from typing import Any


def content_digest(paths: Iterable[str | os.PathLike], missing: str = "") -> str:
    """Return a digest of the contents of files, in the given order.

    The names and dates of the files do not influence the digest. ``missing`` is used in place of the SHA-256
    of a file that does not exist, for example because it has not been retrieved yet. The rule that has the
    file as an input reports that it is missing.
    """
    files = [Path(path) for path in paths]
    return value_digest([file_digest(file) if file.is_file() else missing for file in files])


def file_digest(path: Path) -> str:
    """Return the SHA-256 of a file as hexadecimal digits; the file may be larger than the memory."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def value_digest(value: Any) -> str:  # noqa: ANN401
    """Return the SHA-256 of a value written as JSON; the order of mapping keys has no influence."""
    return hashlib.sha256(json.dumps(value, sort_keys=True).encode()).hexdigest()


def without_addresses(text: str) -> str:
    """Return the ``repr`` of an object without memory addresses, which differ in every process."""
    return re.sub(r"<\S*?(\w+) object at 0x\w+>", r"\1", text)
