"""Joint laws of any variables within limits, which can be fitted to any records, and their interface."""

from abc import abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar, Self

import numpy as np

from accelerated_evaluation.base.arrays import Array
from accelerated_evaluation.laws.protocol import Box, Law


@dataclass(frozen=True)
class Sample:
    """Records to which a joint law is fitted; see `JointLaw.fit`."""

    x: Array
    box: Box
    generator: np.random.Generator
    weights: Array | None = None
    start: Any = None

    @property
    def normalised(self) -> Array:
        """The weights of the n records, shape (n,), scaled so that their sum is n; without weights, ones."""
        return normalised(self.weights, len(self.x))


class JointLaw(Law):
    """A law of d variables within a box that can be fitted to records of any scenario.

    Attributes
    ----------
    candidates
        Settings of `fit` with which the law is a candidate for the records of a scenario, by the name of the
        candidate.

    Examples
    --------
    >>> import accelerated_evaluation as ae
    >>> turns = ae.read_records("left_turn")
    >>> law = ae.LAWS["gaussian_copula"].fit(turns.x, turns.data.box, ae.child_generator(1))
    >>> isinstance(law, ae.JointLaw), law.draw(5, ae.child_generator(2)).shape
    (True, (5, 3))
    """

    candidates: ClassVar[Mapping[str, Mapping[str, int]]]

    @classmethod
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
        box.require(x, "the records")
        return cls.fitted_to(Sample(x, box, generator, weights, start), **settings)

    @classmethod
    @abstractmethod
    def fitted_to(cls, sample: Sample, **settings: int) -> Self:
        """Return the law of this kind that is fitted to records within the box; see `fit`."""

    @property
    @abstractmethod
    def n_parameters(self) -> int:
        """Number of fitted parameters."""

    @property
    def description(self) -> str:
        """The kind of law, in words."""
        return self.kind.replace("_", " ")


def normalised(weights: Array | None, n: int) -> Array:
    """Return the weights of n records, shape (n,), scaled so that their sum is n; without weights, ones."""
    return np.ones(n) if weights is None else weights * (n / weights.sum())
