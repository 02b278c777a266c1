"""The interface of a problem, a problem for any function, and runs of a similar system that guide it."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Annotated, Protocol, runtime_checkable

import numpy as np
from numpy.typing import ArrayLike
from scipy.special import ndtr

from fewruns.arrays import Array, Flags
from fewruns.constants import FEW
from fewruns.errors import InputError

Response = tuple[Flags, Array | None]
PartialResponse = tuple[Flags, Array | None, Flags]  # the last item says which runs have failed
KNOWN = 1e-12  # tail probability at which SciPy still knows the quantiles of all its discrete distributions


class Runnable(Protocol):
    """A system that is run at normal scores, some of whose runs may fail, so that they have no outcome."""

    def evaluate(self, z: Array) -> Response | PartialResponse:
        """Return happened and score, as `ScoreProblem.evaluate`, and perhaps which runs have failed."""


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

    Examples
    --------
    >>> import numpy as np
    >>> import fewruns
    >>> class HalfPlane:
    ...     dimension, fingerprint, deterministic = 2, "half-plane", True
    ...
    ...     def evaluate(self, z):
    ...         return z[:, 0] > 4, 4 - z[:, 0]
    >>> sampler = fewruns.Sampler(2, np.random.default_rng(1), fingerprint="half-plane", deterministic=True)
    >>> goal = fewruns.Stopping(maximum_simulations=1000)
    >>> for _ in fewruns.run_batches(sampler, HalfPlane(), goal):
    ...     pass
    >>> sampler.estimate(goal).converged
    True
    """

    @property
    def dimension(self) -> int:
        """Number d of normal scores."""

    @property
    def fingerprint(self) -> str:
        """A text that identifies the problem."""

    @property
    def deterministic(self) -> bool | None:
        """Whether the same normal scores always give the same outcome; None if this is unknown."""

    def evaluate(self, z: Array) -> Response:
        """Run the system at normal scores z, shape (n, d); return happened and score, shape (n,).

        A score is smaller the closer the run came to the event; the second item is None without scores.
        """


class Marginal(Protocol):
    """The distribution of one input, for example a frozen distribution of `scipy.stats`."""

    def ppf(self, q: ArrayLike) -> Array:
        """Return the quantile x with P(X <= x) = q."""

    def isf(self, q: ArrayLike) -> Array:
        """Return x with P(X > x) = q; it has to be finite and accurate for small q, as far as 1e-30."""


@runtime_checkable
class Discrete(Marginal, Protocol):
    """The distribution of an input with whole values, for example a discrete one of `scipy.stats`."""

    def pmf(self, x: ArrayLike) -> Array:
        """Return P(X = x)."""

    def sf(self, x: ArrayLike) -> Array:
        """Return P(X > x)."""


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
    >>> import numpy as np
    >>> from fewruns import SystemProblem
    >>> from scipy.stats import expon
    >>> waits = SystemProblem(lambda x: (x[:, 0] > 10, 10 - x[:, 0]), 1, [expon(scale=2)])
    >>> happened, score = waits.evaluate(np.array([[0.0], [3.0]]))
    >>> happened.tolist(), score.round(1).tolist()
    ([False, True], [8.6, -3.2])
    """

    respond: Callable[[Array], Response]
    dimension: int
    marginals: Sequence[Marginal] | None = None
    fingerprint: str = "a system with independent inputs"
    deterministic: bool | None = None
    upper_set: bool = False

    def inputs(self, z: Array) -> Array:
        """Map normal scores z to inputs with the distributions `marginals`, both of shape (n, d).

        InputError is raised if a quantile is not finite.
        """
        if self.marginals is None:
            return z
        columns = [normal_score_quantile(law, z[:, k]) for k, law in enumerate(self.marginals)]
        for k, column in enumerate(columns):
            if (lost := np.flatnonzero(~np.isfinite(column))).size:
                raise InputError(
                    f"the distribution of input {k + 1}",
                    seen=f"the quantile {column[lost[0]]} at the normal score {z[lost[0], k]:.3g}",
                    expected="finite numbers, also far in the tails",
                    change="If this input is constant, leave it out and state its value in the function. "
                    "Otherwise correct its parameters, or bound the distribution.",
                )
        return np.column_stack(columns)

    def evaluate(self, z: Array) -> Response:
        """Run the system at normal scores z, shape (n, d); return whether the event happened, and scores."""
        if z.shape[1] != self.dimension:
            seen, expected = f"points with {z.shape[1]} normal scores", f"{self.dimension}, as it has inputs"
            raise InputError("the problem", seen=seen, expected=expected, change="Make another sampler.")
        return self.respond(self.inputs(z))


def normal_score_quantile(law: Marginal, z: Array) -> Array:
    """Return the quantiles x with F(x) = Phi(z), shape (n,), from the smaller of the two tails."""
    value, above = np.empty_like(z), z > 0
    # A side without points is skipped, because the quantile function of a mixture takes long even then.
    if above.any():
        value[above] = _upper_quantile(law, ndtr(-z[above]))
    if not above.all():
        value[~above] = law.ppf(ndtr(z[~above]))
    return value


def _upper_quantile(law: Marginal, q: Array) -> Array:
    """Return the quantiles x with P(X > x) = q, or the smallest whole x with P(X > x) <= q, shape (n,).

    SciPy computes the quantiles of some discrete distributions from 1 - q, which is 1 for small q, and
    returns NaN or infinity. They are then found by bisection of the survival function, which is accurate.
    """
    with np.errstate(divide="ignore"):
        value = np.array(law.isf(q), dtype=float)
    lost = ~np.isfinite(value)
    if not (lost.any() and isinstance(law, Discrete) and np.isfinite(low := law.isf(KNOWN))):
        return value
    low, high = np.full(lost.sum(), low), np.full(lost.sum(), low + 1)
    while (short := law.sf(high) > q[lost]).any():
        high = np.where(short, 2 * high - low, high)
    while (high - low > 1).any():
        middle = np.floor((low + high) / 2)
        short = law.sf(middle) > q[lost]
        low, high = np.where(short, middle, low), np.where(short, high, middle)
    value[lost] = high
    return value


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

    def __post_init__(self) -> None:
        """Take lists as arrays."""
        object.__setattr__(self, "z", np.asarray(self.z, dtype=float))
        object.__setattr__(self, "happened", np.asarray(self.happened))

    def check(self, dimension: int) -> None:
        """Raise InputError if the runs cannot be used for a problem with ``dimension`` normal scores."""
        shape, change = (len(self.happened), dimension), "Leave the predecessor out, or name other runs."
        for fits, seen, expected in (
            (dimension <= FEW, f"{dimension} inputs", f"at most {FEW}"),
            (self.z.shape == shape, f"points of the shape {self.z.shape}", f"{shape}"),
            (self.happened.dtype == bool, f"flags of the type {self.happened.dtype}", "booleans"),
            (np.isfinite(self.z).all(), "points that are not finite", "finite normal scores"),
            (self.happened.any(), "no event in its runs", "at least one"),
        ):
            if not fits:
                raise InputError("predecessor", seen=seen, expected=expected, change=change)
