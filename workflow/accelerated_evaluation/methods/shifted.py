"""A method beyond the paper: truncation points move up in every iteration, towards the events."""

from typing import Any, ClassVar

from accelerated_evaluation.methods import METHODS
from accelerated_evaluation.methods.cross_entropy.levels import Shift
from accelerated_evaluation.methods.piecewise import Piecewise


@METHODS.add("shifted")
class Shifted(Piecewise):
    """The method `Piecewise` whose truncation points move up towards the events.

    The paper's `Heuristic` moves them only if an iteration has too few events. Here they move by one step
    after every update that leaves the tail of a variable with the largest allowed weight, as long as the last
    truncation point stays at least one step below all events.
    """

    name: ClassVar[str] = "shifted"
    style: ClassVar[dict[str, Any]] = {"color": "#e6842a", "linestyle": (0, (5, 1)), "marker": "<"}

    def shift(self) -> Shift:
        """Return the steps by which the truncation points of both coordinates move up."""
        return Shift(**self.cross_entropy["truncation_shift"], every_iteration=True)
