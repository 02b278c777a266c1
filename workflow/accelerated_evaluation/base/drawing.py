"""The settings of Matplotlib with which this project draws, whatever those of the user are."""

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from typing import Any


@contextmanager
def own_settings(changes: Mapping[Any, Any]) -> Iterator[None]:
    """Draw within a ``with`` block with the defaults of Matplotlib and the given ``changes``.

    The user's settings (``matplotlibrc``) would give other figures, or none, if they ask for LaTeX and it is
    not installed. They apply again after the block.
    """
    import matplotlib as mpl  # slow to import, and many programs draw nothing

    with mpl.rc_context():
        mpl.rcdefaults()
        mpl.rcParams.update(changes)
        yield
