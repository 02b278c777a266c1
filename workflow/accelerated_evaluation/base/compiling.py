"""Compile functions with numba, and solve small systems of linear equations in compiled code."""

from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

from numba import njit

from accelerated_evaluation.base.arrays import Array


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


@cached_njit()
def solve(matrix: Array, right: Array) -> None:
    """Overwrite the right-hand side with the solution, and the diagonal of the matrix with the pivots.

    The matrix is positive definite and small. Such a matrix needs no pivoting, and for a small one a call of
    LAPACK would take longer than the solution. The determinant is the product of the pivots.
    """
    size = len(right)
    for one in range(size):
        for two in range(one + 1, size):
            factor = matrix[two, one] / matrix[one, one]
            right[two] -= factor * right[one]
            for column in range(one, size):
                matrix[two, column] -= factor * matrix[one, column]
    for one in range(size - 1, -1, -1):
        for two in range(one + 1, size):
            right[one] -= matrix[one, two] * right[two]
        right[one] /= matrix[one, one]
