"""The paper's heuristic: the truncation points of the pieces move up as well (section V.C.5)."""

from typing import Any, ClassVar

from accelerated_evaluation.methods import METHODS
from accelerated_evaluation.methods.cross_entropy.search import Shift
from accelerated_evaluation.methods.piecewise import Piecewise


@METHODS.add("heuristic")
class Heuristic(Piecewise):
    """As `Piecewise`, and wherever the tail has all the weight it may have, the truncation points move up."""

    name: ClassVar[str] = "heuristic"
    look: ClassVar[dict[str, Any]] = {"color": "#41ab5d", "linestyle": "-.", "marker": "^"}

    def shift(self) -> Shift:
        """Return the steps of the truncation points."""
        return Shift(**self.cross_entropy["truncation_shift"])
