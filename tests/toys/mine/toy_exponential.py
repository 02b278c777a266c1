"""A toy: a bounded exponential by another name."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

from accelerated_evaluation.laws.distributions.bounded_exponential import BoundedExponential
from accelerated_evaluation.laws.distributions.described import Parameter, distribution


@distribution("toy exponential")
@dataclass(frozen=True)
class ToyExponential(BoundedExponential):
    """As its parent."""

    parameters: ClassVar[Mapping[str, Parameter]] = {"rate": Parameter(power=-1, symbol="q")}
