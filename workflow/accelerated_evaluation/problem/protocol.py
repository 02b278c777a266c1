"""The interface of a problem for samplers, and a problem of any system."""

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from accelerated_evaluation.base.arrays import Array
from accelerated_evaluation.distributions import Distribution
from accelerated_evaluation.distributions.tails import normal_score_quantile

Response = tuple[NDArray[np.bool_], Array | None]


class ScoreProblem(Protocol):
    """The interface of a problem for samplers in the space of normal scores.

    Attributes
    ----------
    dimension
        Number d of normal scores.
    fingerprint
        A text that identifies the problem, so that a saved state is resumed only for the same problem.
    deterministic
        Whether the same normal scores always give the same outcome; None if this is unknown.
    """

    dimension: int
    fingerprint: str
    deterministic: bool | None

    def evaluate(self, z: Array) -> Response:
        """Run the system at normal scores z.

        Parameters
        ----------
        z
            Normal scores, shape (n, d).

        Returns
        -------
        happened : numpy.ndarray
            Whether the event happened, shape (n,).
        score : numpy.ndarray or None
            A number that becomes smaller the closer the run came to the event, shape (n,); None if it is
            unknown.
        """


@dataclass(frozen=True)
class SystemProblem:
    """An event of any system with independent inputs, which need not be a vehicle in a cut-in.

    Attributes
    ----------
    respond
        Function that runs the system on inputs, shape (n, d); it returns the same as `ScoreProblem.evaluate`.
    dimension
        Number d of inputs.
    marginals
        Distributions of the d inputs; None if the inputs are the normal scores themselves.
    fingerprint
        A text that identifies the problem.
    deterministic
        Whether the system gives the same response to the same inputs. By default, a handful of repeated runs
        are used to find out. They detect noise, but not a system that fails once in a hundred runs.
    """

    respond: Callable[[Array], Response]
    dimension: int
    marginals: Sequence[Distribution] | None = None
    fingerprint: str = "a system with independent inputs"
    deterministic: bool | None = None

    def inputs(self, z: Array) -> Array:
        """Map normal scores to inputs, both of shape (n, d)."""
        if self.marginals is None:
            return z
        columns = (normal_score_quantile(law, z[:, k]) for k, law in enumerate(self.marginals))
        return np.column_stack(list(columns))

    def evaluate(self, z: Array) -> Response:
        """Run the system at normal scores, shape (n, d)."""
        return self.respond(self.inputs(z))


def without_addresses(text: str) -> str:
    """Return a representation of objects without their memory addresses, which differ in every process."""
    return re.sub(r"<\S*?(\w+) object at 0x\w+>", r"\1", text)
