"""Interface of a joint law: a probability distribution of the variables of a scenario within limits."""

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar, Self

import numpy as np
from numpy.typing import NDArray

from accelerated_evaluation.base.arrays import Array
from accelerated_evaluation.base.errors import InputError


@dataclass(frozen=True)
class Box:
    """The limits of d named variables, which together form a box.

    Attributes
    ----------
    names
        Names of the variables, which end with their units, like names of columns.
    lower, upper
        Limits of each variable; both are part of the box.
    """

    names: tuple[str, ...]
    lower: tuple[float, ...]
    upper: tuple[float, ...]

    def __post_init__(self) -> None:
        ends = np.array([self.lower, self.upper], dtype=float)
        if ends.shape != (2, len(self.names)) or not np.isfinite(ends).all() or not (ends[0] < ends[1]).all():
            raise ValueError(f"each variable needs a lower limit below a finite upper limit, got {self}")

    @property
    def dimension(self) -> int:
        """Number d of variables."""
        return len(self.names)

    @property
    def volume(self) -> float:
        """Volume of the box: the product of upper minus lower limits."""
        return float(np.prod(np.subtract(self.upper, self.lower)))

    def contains(self, x: Array) -> NDArray[np.bool_]:
        """Return whether each of n points x, shape (n, d), is in the box; the result has shape (n,)."""
        return ((x >= self.lower) & (x <= self.upper)).all(axis=1)

    def require(self, x: Array, where: str) -> None:
        """Raise InputError if one of n points, shape (n, d), is outside the box.

        Parameters
        ----------
        x
            The points.
        where
            Name of the table of points, for the error.
        """
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
        """Return the variables with their limits, for JSON."""
        parts = zip(self.names, self.lower, self.upper, strict=True)
        return [{"name": name, "lower": low, "upper": high} for name, low, high in parts]

    @classmethod
    def from_content(cls, content: list[Mapping[str, Any]]) -> Self:
        """Build a box from the value that `content` returned."""
        names = tuple(str(part["name"]) for part in content)
        return cls(names, *(tuple(float(part[end]) for part in content) for end in ("lower", "upper")))


class JointLaw(ABC):
    """A probability distribution of d variables within a box.

    Attributes
    ----------
    kind
        Name of this kind of law in the registry and in files.
    box
        The variables and their limits. The density is 0 outside of the box.
    """

    kind: ClassVar[str]
    box: Box

    @property
    def dimension(self) -> int:
        """Number d of variables."""
        return self.box.dimension

    @classmethod
    @abstractmethod
    def fit(
        cls,
        x: Array,
        box: Box,
        generator: np.random.Generator,
        *,
        weights: Array | None = None,
        start: Self | None = None,
        **settings: int,
    ) -> Self:
        """Return the law of this kind that is fitted to records.

        Parameters
        ----------
        x
            Records within the box, shape (n, d).
        box
            The variables and their limits.
        generator
            Random generator for starting points.
        weights
            Weight of each record, shape (n,), as in a bootstrap sample; by default all are equal.
        start
            An earlier fit to similar records, from which the iterations begin; by default they begin from
            random starting points.
        settings
            Further settings of the class, such as the number of components.

        Raises
        ------
        InputError
            If a record is outside the box.
        """

    @property
    @abstractmethod
    def n_parameters(self) -> int:
        """Number of fitted parameters."""

    @abstractmethod
    def log_density(self, x: Array) -> Array:
        """Return the log density, shape (n,), at points x, shape (n, d); it is -inf outside the box."""

    @abstractmethod
    def sample(self, n: int, generator: np.random.Generator) -> Array:
        """Draw n independent points from the law, shape (n, d)."""

    @abstractmethod
    def from_normal_scores(self, z: Array) -> Array:
        """Map independent standard normal variables to points that follow the law, both of shape (n, d).

        The map is the inverse Rosenblatt transformation (Rosenblatt 1952). The first variable has its
        marginal distribution, and every further variable has its conditional distribution given the variables
        before.
        """

    def encounters(self, z: Array) -> Array:
        """Return the points at normal scores z, shape (n, d), with one row per variable, shape (d, n)."""
        return self.from_normal_scores(z).T

    @abstractmethod
    def content(self) -> dict[str, Any]:
        """Return the parameters of the law, for JSON."""

    @classmethod
    @abstractmethod
    def from_content(cls, content: Mapping[str, Any], box: Box) -> Self:
        """Build a law from the value that `content` returned, and from its box."""


def normalised(weights: Array | None, n: int) -> Array:
    """Return the weights of n records, shape (n,), scaled so that their sum is n; without weights, ones."""
    return np.ones(n) if weights is None else weights * (n / weights.sum())
