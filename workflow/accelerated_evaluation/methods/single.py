"""The authors' earlier method: f* has one exponential for each variable (paper, sections II and VI)."""

from typing import Any, ClassVar

from accelerated_evaluation.laws import Factors
from accelerated_evaluation.methods import METHODS
from accelerated_evaluation.methods.cross_entropy.families import ProposalFamily, SingleFamily
from accelerated_evaluation.methods.cross_entropy.method import CrossEntropyMethod


@METHODS.add("single")
class Single(CrossEntropyMethod):
    """The method in which f* is one exponential distribution for each coordinate."""

    name: ClassVar[str] = "single"
    style: ClassVar[dict[str, Any]] = {"color": "#b2182b", "linestyle": "--", "marker": "s"}

    def start(self, f: Factors) -> tuple[ProposalFamily, ProposalFamily]:
        """Return the exponential distributions that have the means of f."""
        return SingleFamily.start(f.first), SingleFamily.start(f.second)
