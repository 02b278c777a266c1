"""Laws of encounters: their components, sampling, densities, fits and files."""

from collections.abc import Callable, Mapping
from typing import Any

import pandas as pd

from accelerated_evaluation.base.registry import Registry
from accelerated_evaluation.laws.protocol import Box, Law
from accelerated_evaluation.laws.strata import Factors, StratifiedLaw, Stratum

# Classes of laws, by the name in law files.
LAWS: Registry[type[Law]] = Registry("law", __name__, __path__, "kind", contract=[Law])
# Functions that fit a law of cut-ins to an encounter table by a complete configuration, by the name that a
# user gives to the option --law.
FITS: Registry[Callable[[pd.DataFrame, Mapping[str, Any]], Law]] = Registry(
    "fitted law", __name__, __path__, contract=[Callable]
)

__all__ = ["FITS", "LAWS", "Box", "Factors", "Law", "StratifiedLaw", "Stratum"]
