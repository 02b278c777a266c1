"""The paper's method: the pieces of f are tilted and reweighted (section V)."""

from typing import Any, ClassVar

from accelerated_evaluation.laws import Factors
from accelerated_evaluation.methods import METHODS
from accelerated_evaluation.methods.cross_entropy.families import PiecewiseFamily, ProposalFamily
from accelerated_evaluation.methods.cross_entropy.method import CrossEntropyMethod


@METHODS.add("piecewise")
class Piecewise(CrossEntropyMethod):
    """The method in which every piece of f is tilted by its own theta, and the pieces get new weights."""

    name: ClassVar[str] = "piecewise"
    style: ClassVar[dict[str, Any]] = {"color": "#08306b", "linestyle": "-", "marker": "o"}

    def start(self, f: Factors) -> tuple[ProposalFamily, ProposalFamily]:
        """Return families of f* that begin at f, except that small weights are raised to the lower bound.

        ``f`` contains the fitted distributions of both coordinates in one stratum.
        """
        limits = self.cross_entropy["minimum_weight"], self.cross_entropy["minimum_piece_events"]
        return PiecewiseFamily.start(f.first, *limits), PiecewiseFamily.start(f.second, *limits)
