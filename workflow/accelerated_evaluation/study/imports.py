"""Imports that take a second for what the study has no use for."""

import sys
from collections.abc import Iterator
from contextlib import contextmanager


@contextmanager
def without(module: str) -> Iterator[None]:
    """Import, in the block, as if a module were not installed that others would use if it were.

    The package jsonschema reads a grammar of web addresses, which takes more than a second at each start of
    Snakemake and of each notebook, to check formats that no schema here asks for.
    """
    if module in sys.modules:
        yield
        return
    sys.modules[module] = None
    try:
        yield
    finally:
        del sys.modules[module]
