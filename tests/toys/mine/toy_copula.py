"""A toy: a Gaussian copula by another name, as a candidate for the records of every scenario."""

from dataclasses import dataclass
from typing import ClassVar

from accelerated_evaluation.laws import LAWS
from accelerated_evaluation.laws.joint.copula import GaussianCopula


@LAWS.add("toy_copula")
@dataclass(frozen=True, eq=False)
class ToyCopula(GaussianCopula):
    """As its parent."""

    candidates: ClassVar[dict] = {"toy copula": {}}
