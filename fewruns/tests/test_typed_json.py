"""Dataclasses through JSON: what comes back is equal, and values of other types or shapes are refused."""

import json
from dataclasses import dataclass
from typing import Annotated

import numpy as np
import pytest
from fewruns.arrays import Array, Flags
from fewruns.typed_json import MISFIT, decode, encode


@dataclass(frozen=True)
class Point:
    x: Annotated[Array, "axes"]
    name: str


@dataclass(frozen=True)
class Segment:
    begin: float
    end: float


@dataclass(frozen=True)
class Figure:
    axes: int
    parts: list[Point | Segment]
    table: Annotated[Array, "rows", "axes"]
    flags: Annotated[Flags, "rows"]
    corner: tuple[float, ...]
    weights: dict[str, float]
    note: Annotated[Array, 2] | None = None


PARTS = [Point(np.array([1.0, 0.1]), "a"), Segment(0.0, 2.0), Point(np.zeros(2), "b")]
WHOLE = Figure(2, PARTS, np.array([[1.0, 1 / 3]]), np.array([True]), (0.5,), {"a": 1e-300})
EMPTY = Figure(3, [], np.empty((0, 3)), np.empty(0, bool), (), {}, np.array([np.pi, 2.0]))


@pytest.mark.parametrize("figure", [WHOLE, EMPTY])
def test_what_is_read_is_what_was_written(figure):
    plain = json.loads(json.dumps(encode(figure)))
    read = decode(Figure, plain)
    assert encode(read) == encode(figure)
    assert [type(part) for part in read.parts] == [type(part) for part in figure.parts]
    assert read.table.shape == figure.table.shape  # an empty list alone does not show the number of axes
    assert read.flags.dtype == bool


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("axes", 2.0),
        ("axes", 3),
        ("axes", True),
        ("parts", [{"x": [1.0, 0.1]}]),
        ("parts", [{"x": [1.0], "name": "a"}]),
        ("parts", {}),
        ("table", [[1.0, "x"]]),
        ("table", [[1.0], [1.0, 2.0]]),
        ("table", [1.0, 2.0]),
        ("table", "text"),
        ("table", [[True, 0.5]]),
        ("table", [[1.0, 10**30]]),
        ("flags", [True, False]),
        ("flags", [1.0]),
        ("flags", [1]),
        ("corner", 0.5),
        ("corner", [None]),
        ("weights", {"a": "heavy"}),
        ("note", [1.0]),
    ],
)
def test_other_types_and_shapes_are_refused(name, value):
    with pytest.raises(MISFIT):
        decode(Figure, encode(WHOLE) | {name: value})


def test_a_field_that_is_missing_is_refused():
    plain = encode(WHOLE)
    del plain["weights"]
    with pytest.raises(MISFIT):
        decode(Figure, plain)
