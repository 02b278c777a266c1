"""Atomic writing and reading of JSON files."""

import json
import os
from pathlib import Path
from typing import Any


def write_json(path: str | os.PathLike, value: Any) -> None:  # noqa: ANN401
    """Write a value as JSON: an interruption leaves the earlier file or none, never an incomplete one."""
    path = Path(path).resolve()
    temporary = path.with_name(f".{path.name}.{os.getpid()}")
    try:
        temporary.write_text(json.dumps(value, indent=2, allow_nan=False) + "\n", encoding="utf-8")
        temporary.replace(path)
    finally:
        temporary.unlink(missing_ok=True)


def read_json(path: str | os.PathLike) -> Any:  # noqa: ANN401
    """Read a JSON file; raise ValueError if it has no text, no JSON, or too deeply nested JSON."""
    try:
        return json.loads(Path(path).read_text(encoding="utf-8"))
    except RecursionError as error:
        raise ValueError(f"{path} is nested too deeply") from error
