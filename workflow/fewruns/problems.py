"""The interface of a problem, and a problem for any function of independent inputs."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike
from scipy.special import ndtr

from fewruns.arrays import Array, Flags

Response = tuple[Flags, Array | None]


class ScoreProblem(Protocol):
    """The interface of a problem in the space of normal scores: any object with these members.

    A problem may also have a method ``repeat`` like ``evaluate``, which runs the system again even if the
    outcomes of ``evaluate`` are stored, and an attribute ``upper_set`` as `Sampler`.

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
        """Run the system at normal scores z, shape (n, d); return happened and score, shape (n,).

        A score is smaller the closer the run came to the event; the second item is None without scores.
        """


class Marginal(Protocol):
    """The distribution of one input, for example a frozen distribution of `scipy.stats`."""

    def ppf(self, q: ArrayLike) -> Array:
        """Return the quantile x with P(X <= x) = q."""

    def isf(self, q: ArrayLike) -> Array:
        """Return x with P(X > x) = q; it has to be accurate for small q."""


@dataclass(frozen=True)
class SystemProblem:
    """An event of any system with independent inputs.

    Attributes
    ----------
    respond
        Function that runs the system on inputs, shape (n, d), and returns a pair (happened, score) as
        `ScoreProblem.evaluate` does.
    dimension, fingerprint, deterministic, upper_set
        As in `ScoreProblem`. If ``deterministic`` is None, a sampler repeats a few runs to find out. They
        detect noise, but not a system that fails once in a hundred runs.
    marginals
        Distributions of the d inputs; None if the inputs are the normal scores themselves.

    Examples
    --------
    `run_batches` and `SeveralLaws` have examples.
    """

    respond: Callable[[Array], Response]
    dimension: int
    marginals: Sequence[Marginal] | None = None
    fingerprint: str = "a system with independent inputs"
    deterministic: bool | None = None
    upper_set: bool = False

    def inputs(self, z: Array) -> Array:
        """Map normal scores z to inputs with the distributions `marginals`, both of shape (n, d)."""
        if self.marginals is None:
            return z
        columns = (normal_score_quantile(law, z[:, k]) for k, law in enumerate(self.marginals))
        return np.column_stack(list(columns))

    def evaluate(self, z: Array) -> Response:
        """Run the system at normal scores z, shape (n, d); return whether the event happened, and scores."""
        return self.respond(self.inputs(z))


def normal_score_quantile(law: Marginal, z: Array) -> Array:
    """Return the quantiles x with F(x) = Phi(z), shape (n,), from the smaller of the two tails."""
    value, above = np.empty_like(z), z > 0
    # A side without points is skipped, because the quantile function of a mixture takes long even then.
    if above.any():
        value[above] = law.isf(ndtr(-z[above]))
    if not above.all():
        value[~above] = law.ppf(ndtr(z[~above]))
    return value
