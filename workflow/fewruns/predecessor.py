"""Runs of a similar system, which guide the runs of the system under test."""

from dataclasses import dataclass
from typing import Annotated

from fewruns.arrays import Array, Flags
from fewruns.constants import FEW
from fewruns.errors import InputError


@dataclass(frozen=True)
class Predecessor:
    """Runs of a system that is similar to the one under test, for example an earlier version of it.

    The sampler begins near the events of these runs, without a search. It learns how similar the two systems
    are. The estimate is based on the outcomes of the system under test alone.

    Attributes
    ----------
    z
        Normal scores, shape (m, d); d is at most 10, because the directions on which an event with more
        inputs depends are learnt from scores, which are not known for a predecessor.
    happened
        Whether the event happened, shape (m,). It has to happen in at least one run.

    Examples
    --------
    >>> import numpy as np
    >>> import fewruns
    >>> known = fewruns.Predecessor(np.array([[0.0, 4.6], [0.3, 4.1]]), np.array([True, False]))
    >>> sampler = fewruns.Sampler(2, np.random.default_rng(1), predecessor=known)
    """

    z: Annotated[Array, "runs", "dimension"]
    happened: Annotated[Flags, "runs"]

    def check(self, dimension: int) -> None:
        """Raise InputError if the runs cannot be used for a problem with ``dimension`` normal scores."""
        seen = expected = ""
        if dimension > FEW:
            seen, expected = f"{dimension} inputs", f"at most {FEW}"
        elif self.z.shape != (len(self.happened), dimension):
            seen, expected = f"points of the shape {self.z.shape}", f"{(len(self.happened), dimension)}"
        elif not self.happened.any():
            seen, expected = "no event in its runs", "at least one"
        if seen:
            change = "Leave the predecessor out, or name other runs."
            raise InputError("predecessor", seen=seen, expected=expected, change=change)
