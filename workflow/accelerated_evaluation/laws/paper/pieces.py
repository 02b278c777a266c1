"""Families of distributions for the pieces of a piecewise mixture (paper, section III.B)."""

from contextlib import suppress
from dataclasses import dataclass

import numpy as np

from accelerated_evaluation.base.arrays import Array
from accelerated_evaluation.base.errors import ConvergenceError
from accelerated_evaluation.laws.distributions import DISTRIBUTIONS, Described, Mixture


@dataclass(frozen=True)
class PieceFamily:
    """The family of a piece: a kind of distribution, or mixtures of several components of that kind."""

    kind: str  # name in the registry `DISTRIBUTIONS`, such as ``bounded exponential``
    components: int = 1  # a number above one means a mixture

    @classmethod
    def of(cls, piece: Described) -> "PieceFamily":
        """Return the family to which a fitted piece belongs."""
        if isinstance(piece, Mixture):
            return cls(piece.components[0].kind, len(piece.components))
        return cls(piece.kind)

    def fit(self, x: Array, lower: float, upper: float) -> Described:
        """Return the member of the family that is fitted by maximum likelihood to a sample on [lower, upper).

        ConvergenceError is raised if it cannot be fitted, and InputError if no distribution is of this kind.
        """
        member = DISTRIBUTIONS[self.kind]
        if self.components == 1:
            return member.fit(x, lower, upper)
        return member.fit_mixture(x, lower, upper, self.components)

    def fit_or_simpler(self, x: Array, lower: float, upper: float) -> Described:
        """Return a fit of the family to a sample x, shape (n,), on [lower, upper), or of a simpler family.

        If the family cannot be fitted, the number of components is reduced one by one. If a single component
        cannot be fitted either, a bounded exponential distribution is fitted. This is always possible,
        because its density may also increase, as the density of a few observations may do by chance.
        `PieceFamily.of` returns the family that was fitted.
        """
        for components in range(self.components, 0, -1):
            # If a component loses all its observations, a division by zero leads to one of these errors.
            with suppress(ConvergenceError, ValueError), np.errstate(divide="ignore", invalid="ignore"):
                return PieceFamily(self.kind, components).fit(x, lower, upper)
        return EXPONENTIAL.fit(x, lower, upper)

    def __str__(self) -> str:
        """Return a description of the family."""
        return self.kind if self.components == 1 else f"mixture of {self.components} {self.kind}s"


EXPONENTIAL = PieceFamily("bounded exponential")


def piece_kinds() -> list[str]:
    """Return the names of the distributions that can be fitted to a piece and tilted exponentially."""
    needed = ("fit", "tilt")
    return [kind for kind, member in DISTRIBUTIONS.items() if all(hasattr(member, name) for name in needed)]


def mixture_kinds() -> list[str]:
    """Return the names of those distributions in `piece_kinds` of which mixtures can be fitted."""
    return [kind for kind in piece_kinds() if hasattr(DISTRIBUTIONS[kind], "fit_mixture")]
