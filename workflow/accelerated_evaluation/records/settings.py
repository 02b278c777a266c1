"""How the records of cut-ins are read, as values."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Self


@dataclass(frozen=True)
class CutInSettings:
    """How the records of cut-ins are read, filtered and segmented."""

    data: Mapping[str, Any]  # the source, its own section, and the treatment of invalid and repeated rows
    filters: Mapping[str, float]  # limits of the lead speed [m/s] and the range [m]
    edges: Sequence[float]  # edges of the segments of the lead speed [m/s]

    @classmethod
    def of(cls, config: Mapping[str, Any]) -> Self:
        """Return the settings of a configuration with the sections ``data``, ``filters`` and ``segments``."""
        return cls(config["data"], config["filters"], config["segments"]["lead_speed_edges"])
