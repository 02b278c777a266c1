"""Compile functions with numba."""

from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

from numba import njit


def cached_njit(**options: Any) -> Callable[[Callable], Callable]:  # noqa: ANN401
    """Return a decorator that compiles with numba, and caches on disk if numba finds a writable folder."""

    def compiled(function: Callable) -> Callable:
        _remove_outdated(function.__code__.co_filename)
        try:
            return njit(cache=True, **options)(function)
        except RuntimeError:  # neither the folder of the module nor the home folder is writable
            return njit(**options)(function)

    return compiled


@cache
def _remove_outdated(source: str) -> None:
    """Remove the indices of compiled code that is older than its source file.

    Numba would compile again anyway. But it reads the index first, which fails if a class that a compiled
    function takes has a new name, as after an update of this project.
    """
    module = Path(source)
    if not module.is_file():
        return
    changed = module.stat().st_mtime
    try:
        for index in (module.parent / "__pycache__").glob(f"{module.stem}.*.nbi"):
            if index.stat().st_mtime < changed:
                index.unlink(missing_ok=True)
    except OSError:  # another process removed it first, or the folder is read-only
        pass
