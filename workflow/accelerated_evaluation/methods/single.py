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
        """Return families of f* that begin at the exponential distributions with the means of f.

        ``f`` contains the fitted distributions of both coordinates in one stratum.
        """
        return SingleFamily.start(f.first), SingleFamily.start(f.second)
