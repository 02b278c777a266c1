"""Laws of cut-ins: how each is put together, drawn from, scored and stored."""

from accelerated_evaluation.base.registry import Registry
from accelerated_evaluation.laws.protocol import CutIns, Factors, Law, Stratum

LAWS: Registry[type[Law]] = Registry("law", __name__, __path__)

__all__ = ["LAWS", "CutIns", "Factors", "Law", "Stratum"]
