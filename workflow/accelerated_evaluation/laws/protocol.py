"""The interface of a law of encounters: a probability distribution of the variables of a scenario.

All laws of all scenarios have this interface. Some laws offer more, for functions that need it: a
`StratifiedLaw` of `laws.strata` has strata whose distributions can be tilted, and gives the probability of
an interval of the closing speed; a `JointLaw` of `laws.joint` can be fitted to any records; a `SlicedLaw`
gives the probability of an interval of one variable for given others.
"""

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import wraps
from inspect import isfunction
from typing import TYPE_CHECKING, Any, ClassVar, Protocol, Self, runtime_checkable

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from accelerated_evaluation.base.arguments import Argument, described
from accelerated_evaluation.base.arrays import Array
from accelerated_evaluation.base.checking import checked
from accelerated_evaluation.base.errors import InputError
from accelerated_evaluation.base.files import value_digest
from accelerated_evaluation.base.randomness import DRAWING
from accelerated_evaluation.base.users_code import call, is_of_library

NODES, NODE_WEIGHTS = np.polynomial.legendre.leggauss(32)


def require_points(x: Array, names: Sequence[str], where: str) -> None:
    """Raise InputError, which names the argument ``where``, unless x is n points of these variables."""
    if x.ndim != 2 or x.shape[1] != len(names):
        raise InputError(
            where,
            seen=described(x),
            expected=f"an array of shape (n, {len(names)}) with the columns {', '.join(names)}",
            change="Pass one row for each encounter.",
        )


@checked()
@dataclass(frozen=True)
class Box:
    """The names and limits of d variables, which together form a box.

    Parameters
    ----------
    names
        Names of the variables.
    lower, upper
        Limits of each variable, in its unit; they belong to the box, and may be infinite.

    Raises
    ------
    InputError
        If a lower limit is not below its upper limit.

    Examples
    --------
    >>> import numpy as np
    >>> from accelerated_evaluation import Box
    >>> box = Box(("speed", "distance"), (0.0, 0.0), (35.0, 150.0))
    >>> box.contains(np.array([[10.0, 80.0], [40.0, 80.0]]))
    array([ True, False])
    """

    names: tuple[str, ...]
    lower: tuple[float, ...]
    upper: tuple[float, ...]

    def __post_init__(self) -> None:
        for name in ("lower", "upper"):  # whole numbers would make arrays of integers
            object.__setattr__(self, name, tuple(map(float, getattr(self, name))))
        ends = list(zip(self.lower, self.upper, strict=False))
        sizes = {len({*self.names}), len(self.names), len(self.lower), len(self.upper)}
        if len(sizes) > 1 or not all(low < high for low, high in ends):
            raise InputError(
                "Box",
                seen=f"{len(self.names)} variables with the limits {self.lower} and {self.upper}"[:200],
                expected="different names, and a lower limit below an upper limit for each",
                change="Correct the names or the limits.",
            )

    @property
    def dimension(self) -> int:
        """Number d of variables."""
        return len(self.names)

    @property
    def is_finite(self) -> bool:
        """Whether all limits are finite."""
        return bool(np.isfinite([self.lower, self.upper]).all())

    @checked()
    def contains(self, x: Array) -> NDArray[np.bool_]:
        """Return whether each of n points x, shape (n, d), is in the box; the result has shape (n,)."""
        require_points(x, self.names, "Box.contains, argument x")
        return np.all((x >= self.lower) & (x <= self.upper), axis=1)

    def require(self, x: Array, where: str) -> None:
        """Raise InputError, which names the table ``where``, if a row of x, shape (n, d), is outside."""
        outside = np.flatnonzero(~self.contains(x))
        if outside.size:
            row = outside[0]
            limits = zip(self.names, self.lower, self.upper, strict=True)
            raise InputError(
                f"{where}, row {row + 1}",
                seen=", ".join(f"{name} = {v:g}" for name, v in zip(self.names, x[row], strict=True))
                + f" ({outside.size} rows are outside)",
                expected=", ".join(f"{low:g} <= {name} <= {high:g}" for name, low, high in limits),
                change="Correct the row, leave it out, or change the limits.",
            )

    def content(self) -> list[dict[str, Any]]:
        """Return the variables with their limits, for JSON, where an infinite limit is null."""
        parts = zip(self.names, self.lower, self.upper, strict=True)
        return [{"name": name, "lower": _or_null(low), "upper": _or_null(high)} for name, low, high in parts]

    @classmethod
    def from_content(cls, content: list[Mapping[str, Any]]) -> Self:
        """Build a box from the value that `content` returned."""
        lower, upper = (
            tuple(infinite if part[end] is None else float(part[end]) for part in content)
            for end, infinite in (("lower", -np.inf), ("upper", np.inf))
        )
        return cls(tuple(str(part["name"]) for part in content), lower, upper)


def _or_null(limit: float) -> float | None:
    return float(limit) if np.isfinite(limit) else None


# Shapes of the arrays that methods of a law return, given the law and their arguments.
RETURNED: Mapping[str, Callable[..., tuple[int, ...]]] = {
    "from_normal_scores": lambda law, z: np.shape(z),
    "log_density": lambda law, x: (len(x),),
    "draw": lambda law, n, generator: (n, law.dimension),
}


def _with_points(method: Callable[..., Array]) -> Callable[..., Array]:
    """Return the method of a law of this library, which takes n points, with a check of their shape."""

    @wraps(method)
    def with_checks(self: Law, x: Array) -> Array:
        points = np.asarray(x)
        require_points(points, self.box.names, f"{self.kind}.{method.__name__}")
        return method(self, points)

    return with_checks


def _checked_method(method: Callable[..., Array], shape_of: Callable[..., tuple[int, ...]]) -> Callable:
    """Return the method of a user's law with a check of the array that it returns."""

    @wraps(method)
    def with_checks(self: Law, *given: Any, **named: Any) -> Array:  # noqa: ANN401
        shape = shape_of(self, *given, **named)

        def take(value: Any) -> Array:  # noqa: ANN401
            array = np.asarray(value, dtype=float)
            if array.shape != shape or np.isnan(array).any():
                raise ValueError
            return array

        returns = Argument(f"an array of numbers without NaN, of the shape {shape}", take, "Correct the law.")
        return call(method, self, *given, where=f"law {type(self).__name__}", returns=returns, **named)

    return with_checks


class Law(ABC):
    """A probability distribution of the d variables of a scenario.

    Attributes
    ----------
    kind
        Name of this kind of law in the registry `LAWS` and in law files.
    box
        The variables and their limits; the density is 0 outside.
    description
        What the law is, or to which records it was fitted, in one line.

    See Also
    --------
    accelerated_evaluation.laws.joint.JointLaw : a law that can be fitted to any records.
    accelerated_evaluation.laws.strata.StratifiedLaw : a law of cut-ins in strata of the lead speed.

    Examples
    --------
    >>> import accelerated_evaluation as ae
    >>> law = ae.choose_draws("independent_variables", ae.read_records("left_turn")).law
    >>> x = law.draw(4, ae.child_generator(1))
    >>> law.log_density(x).shape
    (4,)
    """

    kind: ClassVar[str]
    needs_records: ClassVar[bool] = False  # whether all laws of this kind take values from the records
    description: str

    if TYPE_CHECKING:  # a field or a property of each kind of law

        @property
        def box(self) -> Box:
            """The variables and their limits."""

    def __init_subclass__(cls, **more: Any) -> None:  # noqa: ANN401
        """Check what the methods of a user's law return, and the points that those of this library take."""
        super().__init_subclass__(**more)
        for name, shape_of in RETURNED.items():
            method = vars(cls).get(name)
            if isfunction(method) and not is_of_library(cls):
                setattr(cls, name, _checked_method(method, shape_of))
            elif isfunction(method) and name != "draw":
                setattr(cls, name, _with_points(method))

    @property
    def dimension(self) -> int:
        """Number d of variables."""
        return self.box.dimension

    @property
    def strata(self) -> Mapping[str, Any]:
        """The distribution in each stratum of the lead speed, by name; none for most laws."""
        return {}

    @property
    def digest(self) -> str:
        """A text that is the same for two laws if and only if they are the same distribution."""
        return value_digest([self.kind, self.box.content(), self.content()])

    @abstractmethod
    def from_normal_scores(self, z: Array) -> Array:
        """Map independent standard normal variables to points that follow the law, both of shape (n, d).

        The map is the inverse Rosenblatt transformation (Rosenblatt 1952). The first variable has its
        marginal distribution, and every further variable has its conditional distribution given the variables
        before.
        """

    @abstractmethod
    def log_density(self, x: Array) -> Array:
        """Return the log density, shape (n,), at points x, shape (n, d); it is -inf outside the box.

        A factor that all laws of the same records share may be missing: laws of cut-ins take lead speeds
        from the records, and their density is that of range and closing speed given the lead speed.
        """

    @checked(**DRAWING)
    def draw(self, n: int, generator: np.random.Generator) -> Array:
        """Draw n independent points from the law, shape (n, d)."""
        return self.from_normal_scores(generator.standard_normal((n, self.dimension)))

    def with_cap_at(self, closing_speed_max: float) -> "Law":
        """Return the law with another cap on the closing speed [m/s]; most laws have no cap."""
        return self

    @property
    def uses_records(self) -> bool:
        """Whether the law takes values from the table of records, which its file then belongs to."""
        return self.needs_records

    @abstractmethod
    def content(self) -> dict[str, Any]:
        """Return the parameters of the law, for JSON."""

    @classmethod
    @abstractmethod
    def from_content(cls, content: Mapping[str, Any], box: Box, records: pd.DataFrame | None) -> Self:
        """Build a law from the value that `content` returned, its box, and its records if it needs them."""


@runtime_checkable
class SlicedLaw(Protocol):
    """A law whose density can be integrated over any interval of one variable, with the others fixed."""

    def log_slice(self, k: int, x: Array, low: Array, high: Array) -> Array:
        """Return the log of the integral of the density over the variable with index k, shape (n,).

        The other variables are those of the points x, shape (n, d); their values of the variable itself are
        not used. The ends ``low`` and ``high`` of the intervals have the shape (n,). From its lower to its
        upper limit, the result is the log density of the other variables, and the difference of two results
        is the log of a conditional probability. It is accurate in far tails.
        """


def density_over(law: Law, k: int, x: Array, low: Array, high: Array) -> Array:
    """Integrate the density of a law over the variable with index k from low to high, shape (n,).

    The other variables are those of the points x, shape (n, d). The Gauss-Legendre rule has 32 nodes, so that
    the density should be smooth between the ends, which have the shape (n,).
    """
    half = (high - low)[:, None] / 2
    values = half * NODES + (low + high)[:, None] / 2
    points = np.repeat(x, NODES.size, axis=0)
    points[:, k] = values.ravel()
    return half[:, 0] * (np.exp(law.log_density(points)).reshape(values.shape) @ NODE_WEIGHTS)


def log_slice_of(law: Law, k: int, x: Array, low: Array, high: Array) -> Array:
    """Return the result of `SlicedLaw.log_slice` for any law, by quadrature if it has no such method."""
    if isinstance(law, SlicedLaw):
        return law.log_slice(k, x, low, high)
    high = np.minimum(high, law.box.upper[k])
    with np.errstate(divide="ignore"):
        return np.where(low < high, np.log(density_over(law, k, x, low, high)), -np.inf)
