"""The paper's heuristic: truncation points move up if an iteration has too few events (section V.C.5)."""

from typing import Any, ClassVar

from accelerated_evaluation.methods import METHODS
from accelerated_evaluation.methods.cross_entropy.levels import Shift
from accelerated_evaluation.methods.piecewise import Piecewise


@METHODS.add("heuristic")
class Heuristic(Piecewise):
    """The method `Piecewise` whose truncation points move if an iteration has too few events.

    The truncation points of a variable move up by one step if its tail has the largest allowed weight. The
    iteration then draws again, until it has enough events.
    """

    name: ClassVar[str] = "heuristic"
    style: ClassVar[dict[str, Any]] = {"color": "#41ab5d", "linestyle": "-.", "marker": "^"}

    def shift(self) -> Shift:
        """Return the steps by which the truncation points of both coordinates move up."""
        return Shift(**self.cross_entropy["truncation_shift"])
