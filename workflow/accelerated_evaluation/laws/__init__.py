"""Laws of encounters: their components, sampling, densities, fits and files."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import pandas as pd

from accelerated_evaluation.base.registry import Registry
from accelerated_evaluation.laws.protocol import Box, Law
from accelerated_evaluation.laws.strata import Factors, StratifiedLaw, Stratum

# Classes of laws, by the name in law files.
LAWS: Registry[type[Law]] = Registry("law", __name__, __path__, "kind", contract=[Law])
# Functions that fit a law of cut-ins to an encounter table, by the name that a user gives to --law.
FITS: Registry[Callable[[pd.DataFrame, "FitSettings"], Law]] = Registry(
    "fitted law", __name__, __path__, contract=[Callable]
)

__all__ = [
    "FITS",
    "LAWS",
    "Box",
    "Factors",
    "FitSettings",
    "Law",
    "StratifiedLaw",
    "Stratum",
    "nested_content",
    "nested_law",
]


@dataclass(frozen=True)
class FitSettings:
    """What a fit of a law of cut-ins may use, besides the encounter table."""

    models: Mapping[str, Any]  # the section of the configuration that describes the paper's models
    range_max: float  # largest range of the records [m]
    closing_speed_max: float  # cap on the closing speed [m/s]
    description: str  # of the records


def nested_content(law: Law) -> dict[str, Any]:
    """Return what a file says of a law that is a part of another law; `nested_law` builds an equal law."""
    header = {"kind": law.kind, "description": law.description, "variables": law.box.content()}
    return header | law.content()


def nested_law(content: Mapping[str, Any], records: pd.DataFrame | None) -> Law:
    """Return the law with a content, with values from the records if it needs them."""
    box = Box.from_content(content["variables"])
    return LAWS[content["kind"]].from_content(content, box, records)
