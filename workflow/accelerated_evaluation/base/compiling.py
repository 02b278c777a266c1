"""Compile functions with numba."""

from collections.abc import Callable

from numba import njit


def cached_njit(**options: bool | str) -> Callable[[Callable], Callable]:
    """Return a decorator that compiles with numba, and caches on disk if numba finds a writable folder."""

    def compiled(function: Callable) -> Callable:
        try:
            return njit(cache=True, **options)(function)
        except RuntimeError:  # neither the folder of the module nor the home folder is writable
            return njit(**options)(function)

    return compiled
