"""The interface of distributions, their descriptions for files and figures, and their registry."""

import dataclasses
import math
from abc import ABC
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, Protocol, Self, TypeVar, runtime_checkable

import numpy as np
from numpy.typing import ArrayLike

from accelerated_evaluation.base.arrays import Array
from accelerated_evaluation.base.registry import Registry

INFINITE = {"lower": -math.inf, "upper": math.inf}


@runtime_checkable
class Distribution(Protocol):
    """A univariate distribution on ``[lower, upper)``.

    All functions work element by element on arrays of any shape. They are accurate in far tails: ``logsf``
    works in logarithms, and ``isf`` accepts probabilities down to the smallest positive double.
    """

    @property
    def lower(self) -> float:
        """Lower end of the support."""

    @property
    def upper(self) -> float:
        """Upper end of the support; it may be infinite."""

    def logpdf(self, x: ArrayLike) -> Array:
        """Return the log density at x; -inf outside the support."""

    def cdf(self, x: ArrayLike) -> Array:
        """Return P(X <= x)."""

    def sf(self, x: ArrayLike) -> Array:
        """Return P(X > x)."""

    def logsf(self, x: ArrayLike) -> Array:
        """Return log P(X > x)."""

    def ppf(self, q: ArrayLike) -> Array:
        """Return the quantile x with P(X <= x) = q, for q in [0, 1]."""

    def isf(self, q: ArrayLike) -> Array:
        """Return x with P(X > x) = q, for q in [0, 1]; it is accurate for small q."""

    def mean(self) -> float:
        """Return the mean E X."""

    def rvs(self, generator: np.random.Generator, size: int) -> Array:
        """Return independent draws from the distribution, shape (size,)."""

    def interval_probability(self, start: ArrayLike, end: ArrayLike) -> Array:
        """Return P(start <= X < end), element by element; the end may be infinite."""

    def leaves(self) -> Iterator[tuple[float, Any]]:
        """Yield the weight and the distribution of each component that is not a mixture itself."""


@runtime_checkable
class Tiltable(Distribution, Protocol):
    """A distribution that can be tilted exponentially (change of measure; paper, section IV.B)."""

    @property
    def theta_limit(self) -> float:
        """Upper limit of the parameter theta of the tilting; it may be infinite."""

    def cumulant(self, theta: float) -> float:
        """Return kappa(theta) = log E exp(theta X), the log moment generating function."""

    def to_dict(self) -> dict[str, Any]:
        """Return the kind and the parameters as a dictionary for JSON."""

    def tilt(self, theta: float) -> Self:
        """Return the exponentially tilted distribution, with density exp(theta x - kappa(theta)) f(x)."""


@dataclass(frozen=True)
class Parameter:
    """Description of a fitted parameter for tables and figures."""

    # The unit of the parameter is the unit of the variable to this power: -1 for a rate, 1 for a scale, 0 for
    # a pure number.
    power: int
    symbol: str  # in TeX, without the dollar signs


if TYPE_CHECKING:  # a protocol as a base would make its empty methods look like methods of each subclass
    _Base = Distribution
else:
    _Base = ABC


class Described(_Base):
    """Base class of the distributions that files, tables and the configuration identify by their kind.

    A subclass is a frozen dataclass of numbers, registered with the decorator `distribution`. If it can be
    fitted to a part of a sample, it has a classmethod ``fit(x, lower, upper)``, which maximizes the
    likelihood. If mixtures of it can be fitted as well, it has a classmethod ``fit_mixture(x, lower, upper,
    components)``.
    """

    kind: ClassVar[str]  # name of the distribution in files, tables and the configuration
    # Descriptions of the fitted parameters by the name of their field. The bounds of the support are not
    # fitted and therefore not included.
    parameters: ClassVar[Mapping[str, Parameter]] = {}

    @property
    def n_parameters(self) -> int:
        """Number of fitted parameters."""
        return len(self.parameters)

    def rebounded(self, lower: float, upper: float) -> Self:
        """Return a distribution with the same parameters and the support [lower, upper)."""
        return dataclasses.replace(self, lower=lower, upper=upper)

    def interval_probability(self, start: ArrayLike, end: ArrayLike) -> Array:
        """Return P(start <= X < end), element by element, without subtracting nearly equal numbers.

        The end may be infinite.
        """
        low = self.logsf(start)
        with np.errstate(invalid="ignore"):
            return np.where(np.isneginf(low), 0.0, np.exp(low) * -np.expm1(self.logsf(end) - low))

    def leaves(self) -> Iterator[tuple[float, Any]]:
        """Yield the distribution itself, with the weight one."""
        yield 1.0, self

    @np.errstate(over="ignore")
    def sf(self, x: ArrayLike) -> Array:
        """Return P(X > x)."""
        return np.exp(self.logsf(x))

    def rvs(self, generator: np.random.Generator, size: int) -> Array:
        """Return independent draws, shape (size,), by the inverse cdf."""
        return self.ppf(generator.random(size))

    def to_dict(self) -> dict[str, Any]:
        """Return the kind and the fields as a dictionary for JSON; an infinite bound is null."""
        values = {field.name: float(getattr(self, field.name)) for field in dataclasses.fields(self)}
        numbers = {name: None if math.isinf(value) else value for name, value in values.items()}
        return {"kind": self.kind, **numbers}

    @classmethod
    def from_content(cls, content: Mapping[str, Any]) -> Self:
        """Build the distribution from the dictionary that `to_dict` returned, without the kind."""
        return cls(**{name: INFINITE[name] if value is None else value for name, value in content.items()})


DISTRIBUTIONS: Registry[type[Described]] = Registry(
    "distribution", __package__, [str(Path(__file__).parent)], contract=[Described, Distribution]
)

DescribedClass = TypeVar("DescribedClass", bound=type[Described])


def distribution(kind: str) -> Callable[[DescribedClass], DescribedClass]:
    """Return the class decorator that assigns a kind (name in files) to a distribution and registers it."""

    def register(cls: DescribedClass) -> DescribedClass:
        cls.kind = kind
        return DISTRIBUTIONS.add(kind)(cls)

    return register


def from_dict(content: Mapping[str, Any]) -> Any:  # noqa: ANN401
    """Build a distribution from the dictionary that its method ``to_dict`` returned.

    AttributeError, KeyError, TypeError or ValueError is raised if it describes no distribution of a known
    kind.
    """
    content = dict(content)
    kind = content.pop("kind")
    if kind not in DISTRIBUTIONS:
        raise ValueError(f"no distribution is of kind {kind!r}; known are {', '.join(DISTRIBUTIONS)}")
    return DISTRIBUTIONS[kind].from_content(content)


def unit_to_power(unit: str, power: int) -> str:
    """Return a unit raised to a power: ``1/s`` to the power -1 is ``s``, and to the power 0 it is ``1``."""
    base = unit.removeprefix("1/")
    exponent = power if base == unit else -power
    if exponent == 0:
        return "1"
    text = base if abs(exponent) == 1 else f"{base}^{abs(exponent)}"
    return text if exponent > 0 else f"1/{text}"
