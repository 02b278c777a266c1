"""The paper's heuristic, which also moves the truncation points of the pieces up (section V.C.5)."""

from typing import Any, ClassVar

from accelerated_evaluation.methods import METHODS
from accelerated_evaluation.methods.cross_entropy.search import Shift
from accelerated_evaluation.methods.piecewise import Piecewise


@METHODS.add("heuristic")
class Heuristic(Piecewise):
    """The method `Piecewise` with moving truncation points.

    The truncation points of a variable move up when its tail has the largest allowed weight.
    """

    name: ClassVar[str] = "heuristic"
    style: ClassVar[dict[str, Any]] = {"color": "#41ab5d", "linestyle": "-.", "marker": "^"}

    def shift(self) -> Shift:
        """Return the steps by which the truncation points of both coordinates move up."""
        return Shift(**self.cross_entropy["truncation_shift"])
