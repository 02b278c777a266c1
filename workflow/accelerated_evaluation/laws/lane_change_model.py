"""The lane-change model f(v_L) f(R^-1) f(TTC^-1 | segment), and its file, read and written here alone."""

import os
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from accelerated_evaluation.distributions import Described, from_dict
from accelerated_evaluation.errors import InputError
from accelerated_evaluation.files import read_json, write_json

FORMAT = "accelerated-evaluation lane-change model"
VERSION = 1
UNITS = {"inverse_range": "1/m", "inverse_ttc": "1/s"}


@dataclass(frozen=True)
class LaneChangeModel:
    """Laws of R^-1 [1/m], the same in all segments, and of TTC^-1 [1/s] in each (paper, section VI.A).

    Attributes
    ----------
    description
        What it was fitted to.
    events
        Number of lane changes by segment of v_L; their shares weigh the segments.

    Raises
    ------
    ValueError
        If counts and laws are not of the same segments, or a count is not positive.
    """

    description: str
    events: Mapping[str, int]
    inverse_range: Described
    inverse_ttc: Mapping[str, Described]

    def __post_init__(self) -> None:
        if not self.events or set(self.events) != set(self.inverse_ttc):
            raise ValueError(f"events of segments {[*self.events]}, but TTC^-1 of {[*self.inverse_ttc]}")
        if not all(isinstance(count, int) and count > 0 for count in self.events.values()):
            raise ValueError(f"events must be positive whole numbers, got {dict(self.events)}")

    @property
    def segments(self) -> tuple[str, ...]:
        """Names of the segments, by rising speed."""
        return tuple(self.events)

    @property
    def n_parameters(self) -> int:
        """Number of fitted parameters, knots not counted (paper, table II: 18 and 4)."""
        return self.inverse_range.n_parameters + sum(law.n_parameters for law in self.inverse_ttc.values())

    def share(self, segment: str) -> float:
        """Share of all lane changes that fall into a segment."""
        return self.events[segment] / sum(self.events.values())


def write_model(path: str | os.PathLike, model: LaneChangeModel) -> None:
    """Write a model as JSON, atomically; what is read back is equal to it."""
    laws = {segment: law.to_dict() for segment, law in model.inverse_ttc.items()}
    write_json(
        path,
        {
            "format": FORMAT,
            "version": VERSION,
            "description": model.description,
            "events": dict(model.events),
            "inverse_range": {"unit": UNITS["inverse_range"], "distribution": model.inverse_range.to_dict()},
            "inverse_ttc": {"unit": UNITS["inverse_ttc"], "distributions": laws},
        },
    )


def read_model(path: str | os.PathLike) -> LaneChangeModel:
    """Read a model file.

    Raises
    ------
    InputError
        If the file is missing, or is not a model of this version.
    """
    change = "Fit the model anew, or name a model file that this version wrote."
    if not Path(path).is_file():
        raise InputError(str(path), seen="no such file", expected="a model file", change=change)
    try:
        content = read_json(path)
        kind = content["format"], content["version"]
        if kind != (FORMAT, VERSION):
            raise InputError(str(path), seen=f"{kind}", expected=f"{(FORMAT, VERSION)}", change=change)
        laws = content["inverse_ttc"]["distributions"]
        return LaneChangeModel(
            description=content["description"],
            events=content["events"],
            inverse_range=from_dict(content["inverse_range"]["distribution"]),
            inverse_ttc={segment: from_dict(law) for segment, law in laws.items()},
        )
    except (AttributeError, KeyError, TypeError, ValueError) as error:
        seen = f"{type(error).__name__}: {error}"
        raise InputError(str(path), seen=seen, expected="a whole model file", change=change) from error
