"""What the pieces of a piecewise mixture are fitted with (paper, section III.B)."""

from contextlib import suppress
from dataclasses import dataclass

import numpy as np

from accelerated_evaluation.base.arrays import Array
from accelerated_evaluation.base.errors import ConvergenceError
from accelerated_evaluation.distributions import DISTRIBUTIONS, Described, Mixture


@dataclass(frozen=True)
class PieceFamily:
    """A kind of distribution, or a mixture of several of that kind.

    Attributes
    ----------
    kind
        Name of the distribution in the registry `DISTRIBUTIONS`, such as ``bounded exponential``.
    components
        Number of components; more than one make a mixture.
    """

    kind: str
    components: int = 1

    @classmethod
    def of(cls, piece: Described) -> "PieceFamily":
        """Return the family that a fitted piece is a member of."""
        if isinstance(piece, Mixture):
            return cls(piece.components[0].kind, len(piece.components))
        return cls(piece.kind)

    def fit(self, x: Array, lower: float, upper: float) -> Described:
        """Fit the family to x, shape (n,), on [lower, upper) by maximum likelihood.

        Raises
        ------
        InputError
            If no distribution is of this kind.
        ConvergenceError
            If the distribution cannot be fitted to these data.
        """
        member = DISTRIBUTIONS[self.kind]
        if self.components == 1:
            return member.fit(x, lower, upper)
        return member.fit_mixture(x, lower, upper, self.components)

    def fit_or_simpler(self, x: Array, lower: float, upper: float) -> Described:
        """Fit the family or, if that cannot be done, the first simpler one that can; arguments as of `fit`.

        First one component after the other is given up, then the kind: a bounded exponential is always there,
        because it may also rise, as few observations by chance do. `PieceFamily.of` tells what was fitted.
        """
        for components in range(self.components, 0, -1):
            # A component that has lost all its observations divides by zero, and ends in one of these errors.
            with suppress(ConvergenceError, ValueError), np.errstate(divide="ignore", invalid="ignore"):
                return PieceFamily(self.kind, components).fit(x, lower, upper)
        return EXPONENTIAL.fit(x, lower, upper)

    def __str__(self) -> str:
        """Return the family in words."""
        return self.kind if self.components == 1 else f"mixture of {self.components} {self.kind}s"


EXPONENTIAL = PieceFamily("bounded exponential")


def piece_kinds() -> list[str]:
    """Return the kinds of distribution that can be fitted to a piece and tilted, as the pieces of f are."""
    needed = ("fit", "tilt")
    return [kind for kind, member in DISTRIBUTIONS.items() if all(hasattr(member, name) for name in needed)]


def mixture_kinds() -> list[str]:
    """Return those of the `piece_kinds` of which mixtures can be fitted."""
    return [kind for kind in piece_kinds() if hasattr(DISTRIBUTIONS[kind], "fit_mixture")]
