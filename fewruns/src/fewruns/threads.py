"""One thread for linear algebra: matrices are small, and results must not depend on the number of cores."""

from collections.abc import Iterator
from contextlib import contextmanager
from threading import Lock
from typing import Any

from threadpoolctl import ThreadpoolController

BLAS = ThreadpoolController()
_lock = Lock()
_limits: list[Any] = []
_inside = 0


@contextmanager
def one_thread() -> Iterator[None]:
    """Limit the linear algebra of the process to one thread in a ``with`` block.

    The number of threads is a setting of the process. The first of several blocks that overlap, in other
    threads of Python, limits it, and the last one restores it.
    """
    global _inside
    with _lock:
        _inside += 1
        if _inside == 1:
            _limits.append(BLAS.limit(limits=1, user_api="blas"))
    try:
        yield
    finally:
        with _lock:
            _inside -= 1
            if not _inside:
                _limits.pop().restore_original_limits()
