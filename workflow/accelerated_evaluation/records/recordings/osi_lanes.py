"""Lanes of the vehicles in a trace of ASAM OSI, which may be described by a map in ASAM OpenDRIVE."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from accelerated_evaluation.base.arrays import Array
from accelerated_evaluation.records.recordings.centre_lines import CentreLines, Piece, joined_lanes

if TYPE_CHECKING:  # an optional extra
    from betterosi import GroundTruth, Lane, MovingObject
from collections import defaultdict
from collections.abc import Iterator
from itertools import accumulate, pairwise
from math import inf
from xml.etree import ElementTree
from xml.etree.ElementTree import Element

from accelerated_evaluation.base.errors import DAMAGE, readable

STEP = 0.5  # [m] between the points of a centre line
# Types of lanes in which no car drives. A car on the hard shoulder is in a lane, and one on a border in none.
NO_CARS = ("none", "sidewalk", "walking", "biking", "border", "curb", "median", "rail", "tram")
NODES, WEIGHTS = np.polynomial.legendre.leggauss(16)  # exact to a micrometre for curves of less than a turn

Lane = tuple[str, int, int]  # road, section of the road (counted from 0; -1 is the last), and lane
Connections = dict[tuple[str, str, int], list[Lane]]  # by junction, incoming road and lane of this road
MAP_TOPICS = ["/ground_truth_map", "ground_truth_map"]  # channels of a map in a trace of omega-prime


def lanes_of_map(text: str | bytes, where: str) -> list[Piece]:
    """Return the lanes in which cars may drive of an OpenDRIVE map, with a piece in each section of a road.

    Heights and inclinations are ignored. InputError is raised if the text is no such map, or contains a curve
    or a description of lanes that is not supported.
    """
    expected = "an OpenDRIVE map with lines, arcs, spirals or paramPoly3, and lanes with widths"
    change = "Write the map in this form, or assign the vehicles to lanes (assigned_lane_id)."
    with readable(where, expected, change, (*DAMAGE, ElementTree.ParseError)):
        content = ElementTree.fromstring(text)
        for element in content.iter():  # some tools write a namespace
            element.tag = element.tag.rpartition("}")[2]
        roads = content.findall("road")
        connections = _connections(content)
        sections = {road.attrib["id"]: len(road.findall("lanes/laneSection")) for road in roads}
        found = {lane: parts for road in roads for lane, parts in _lanes_of_road(road, connections)}
    numbers = {lane: number for number, lane in enumerate(found)}

    def numbered(lanes: list[Lane]) -> frozenset[int]:
        known = ((road, section % sections.get(road, 1), lane) for road, section, lane in lanes)
        return frozenset(numbers[lane] for lane in known if lane in numbers)

    return [
        Piece(numbers[lane], line, numbered(before), numbered(after), half_width)
        for lane, (line, half_width, before, after) in found.items()
    ]


def _connections(content: Element) -> Connections:
    """Return, for each junction, incoming road and lane, the lanes that continue it in the junction."""
    found: Connections = defaultdict(list)
    for junction in content.findall("junction"):
        for connection in junction.findall("connection"):
            # A direct junction names the road beyond it as linkedRoad, and others a road within the junction.
            road = connection.get("connectingRoad") or connection.get("linkedRoad")
            section = 0 if connection.get("contactPoint") == "start" else -1
            for link in connection.findall("laneLink") if road else ():
                lane = junction.attrib["id"], connection.attrib["incomingRoad"], int(link.attrib["from"])
                found[lane].append((road, section, int(link.attrib["to"])))
    return found


def _lanes_of_road(
    road: Element, connections: Connections
) -> Iterator[tuple[Lane, tuple[Array, Array, list[Lane], list[Lane]]]]:
    """Yield the lanes of a road: centre line [m], shape (n, 2), half-widths [m], (n,), and continuations."""
    name, offsets = road.attrib["id"], road.findall("lanes/laneOffset")
    sections = road.findall("lanes/laneSection")
    ends = [float(section.attrib["s"]) for section in sections] + [float(road.attrib["length"])]
    for place, (section, (start, end)) in enumerate(zip(sections, pairwise(ends), strict=True)):
        if section.get("singleSide") == "true":
            raise ValueError("a laneSection with singleSide")
        s = np.linspace(start, end, 2 + int((end - start) / STEP))
        x, y, heading = _reference(road, s)
        for side, sign in (("left", 1), ("right", -1)):
            lanes = sorted(section.findall(f"{side}/lane"), key=lambda lane: abs(int(lane.attrib["id"])))
            widths = [_cubic(lane.findall("width"), "sOffset", s - start) for lane in lanes]
            if any((width < -1e-3).any() for width in widths):  # [m], beyond rounding errors
                raise ValueError("a lane with a negative width")
            inner = accumulate(widths, initial=np.zeros(s.size))
            for lane, width, edge in zip(lanes, widths, inner, strict=False):
                if lane.find("border") is not None:
                    raise ValueError("a lane with borders in place of widths")
                if lane.attrib["type"] not in NO_CARS:
                    across = _cubic(offsets, "s", s) + sign * (edge + width / 2)
                    line = np.column_stack([x - across * np.sin(heading), y + across * np.cos(heading)])
                    links = [
                        _continuations(road, lane, place + way, len(sections), kind, connections)
                        for way, kind in ((-1, "predecessor"), (1, "successor"))
                    ]
                    yield (name, place, int(lane.attrib["id"])), (line, width / 2, *links)


def _continuations(
    road: Element, lane: Element, place: int, sections: int, kind: str, connections: Connections
) -> list[Lane]:
    """Return the lanes that continue a lane into its predecessor or successor, the section at ``place``."""
    named = [int(link.attrib["id"]) for link in lane.findall(f"link/{kind}")]
    if 0 <= place < sections:
        return [(road.attrib["id"], place, each) for each in named]
    other = road.find(f"link/{kind}")
    if other is None:
        return []
    if other.get("elementType") == "junction":
        return connections.get((other.attrib["elementId"], road.attrib["id"], int(lane.attrib["id"])), [])
    section = 0 if other.get("contactPoint") == "start" else -1
    return [(other.attrib["elementId"], section, each) for each in named]


def _reference(road: Element, s: Array) -> tuple[Array, Array, Array]:
    """Return x, y [m] and heading [rad] of the reference line of a road at distances along it [m]."""
    curves = road.findall("planView/geometry")
    starts = [float(curve.attrib["s"]) for curve in curves]
    chosen = np.maximum(np.searchsorted(starts, s, side="right") - 1, 0)
    found = np.empty((3, s.size))
    for i in np.unique(chosen):
        x, y, heading = (float(curves[i].attrib[key]) for key in ("x", "y", "hdg"))
        u, v, turned = _curve(curves[i], s[chosen == i] - starts[i])
        cos, sin = np.cos(heading), np.sin(heading)
        found[:, chosen == i] = x + u * cos - v * sin, y + u * sin + v * cos, heading + turned
    return found[0], found[1], found[2]


def _curve(curve: Element, s: Array) -> tuple[Array, Array, Array]:
    """Return coordinates u, v [m] relative to the start of a curve, and the turn of its heading [rad]."""
    length = float(curve.attrib["length"])
    if (cubic := curve.find("paramPoly3")) is not None:
        p = s if cubic.get("pRange") == "arcLength" else s / length
        u, v = (
            np.polynomial.Polynomial([float(cubic.attrib[power + axis]) for power in "abcd"]) for axis in "UV"
        )
        return u(p), v(p), np.arctan2(v.deriv()(p), u.deriv()(p))
    first, last = _curvatures(curve)
    change = (last - first) / length / 2
    nodes = s[:, None] * (NODES + 1) / 2
    headings = first * nodes + change * nodes**2
    u, v = (s / 2 * (part @ WEIGHTS) for part in (np.cos(headings), np.sin(headings)))
    return u, v, first * s + change * s**2


def _curvatures(curve: Element) -> tuple[float, float]:
    """Return the curvatures [1/m] at the start and at the end of a line, an arc or a spiral."""
    if curve.find("line") is not None:
        return 0.0, 0.0
    if (arc := curve.find("arc")) is not None:
        return (float(arc.attrib["curvature"]),) * 2
    if (spiral := curve.find("spiral")) is not None:
        return float(spiral.attrib["curvStart"]), float(spiral.attrib["curvEnd"])
    raise ValueError(f"a curve of the kind {', '.join(child.tag for child in curve) or 'unknown'}")


def _cubic(parts: list[Element], key: str, s: Array) -> Array:
    """Return piecewise cubic polynomials at distances [m]; 0 before the first part, or without parts."""
    starts = [-inf, *(float(part.attrib[key]) for part in parts)]
    chosen = np.searchsorted(starts, s, side="right") - 1
    values = np.zeros(s.size)
    for i, part in enumerate(parts, 1):
        at = s[chosen == i] - starts[i]
        values[chosen == i] = np.polynomial.polynomial.polyval(
            at, [float(part.attrib[power]) for power in "abcd"]
        )
    return values


class TraceLanes:
    """Lanes to which a trace assigns its vehicles, or otherwise those on whose centre lines they drive.

    If the first message with vehicles assigns none of them to a lane, the centre lines are those of the lanes
    in the messages up to this one. If there are none, they are those of the OpenDRIVE map in the trace, or of
    the map next to the trace that `map_reference` names.
    """

    def __init__(self, file: Path) -> None:
        self._file = file
        self._lanes: Sequence[Lane] = ()
        self._joined: dict[int, int] = {}
        self._centres: CentreLines | None = None
        self._has_begun = False

    def of_vehicles(
        self, message: "GroundTruth", vehicles: Sequence["MovingObject"], x: Array, y: Array, yaw: Array
    ) -> list[int | None]:
        """Return the lane of each vehicle of a message, None for a vehicle in no lane.

        Messages must be given in their order. ``x``, ``y`` [m] and ``yaw`` [rad] have the shape (n,).
        """
        if message.lane and not self._lanes:
            self._lanes = message.lane
            self._joined = joined_lanes(_piece(lane) for lane in message.lane)
        lanes = [_assigned(one) for one in vehicles]
        if vehicles and not self._has_begun:
            self._has_begun = True
            if lanes.count(None) == len(lanes):
                self._read_centre_lines(message.map_reference)
        if self._centres is not None:
            lanes = self._centres.nearest(x, y, yaw)
        return [None if lane is None else self._joined.get(lane, lane) for lane in lanes]

    def _read_centre_lines(self, map_reference: str) -> None:
        """Use the centre lines of the lanes that have been read or, if there are none, those of a map."""
        drawn = [_piece(lane) for lane in self._lanes if _is_for_vehicles(lane)]
        if not any(len(piece.line) for piece in drawn):
            drawn = _lanes_of_map(self._file, map_reference)
            self._joined = joined_lanes(drawn)
        self._centres = CentreLines.of(drawn)


def _assigned(one: "MovingObject") -> int | None:
    """Return the lane to which a vehicle is assigned with the largest percentage, the first of equal ones."""
    newer = one.moving_object_classification
    lanes = [*(newer.assigned_lane_id if newer else ()), *one.assigned_lane_id]
    shares = list(newer.assigned_lane_percentage) if newer else []
    if len(shares) == len(lanes) > 0:
        return lanes[int(np.argmax(shares))].value
    return lanes[0].value if lanes else None


def _is_for_vehicles(lane: "Lane") -> bool:
    """Return whether vehicles drive in a lane; shoulders and borders are often narrow, of unknown width."""
    return lane.classification is not None and lane.classification.type.name != "NONDRIVING"


def _piece(lane: "Lane") -> Piece:
    """Return the piece of a lane that a message of OSI describes."""
    described = lane.classification
    if described is None:
        return Piece(lane.id.value, np.empty((0, 2)))
    ends = [
        frozenset(
            end.value for pairing in described.lane_pairing if (end := getattr(pairing, name)) is not None
        )
        for name in ("antecessor_lane_id", "successor_lane_id")
    ]
    line = np.array([(point.x, point.y) for point in described.centerline], dtype=float).reshape(-1, 2)
    return Piece(lane.id.value, line, *ends)


def _lanes_of_map(file: Path, reference: str) -> list[Piece]:
    """Return the lanes of the map in a trace, or of the file next to it with the name ``reference``."""
    import betterosi

    if file.suffix == ".mcap":
        for message in betterosi.read(str(file), mcap_topics=MAP_TOPICS):
            return lanes_of_map(message.open_drive_xml_content, f"{file}, OpenDRIVE map")
    beside = file.parent / Path(reference).name
    if beside.suffix == ".xodr" and beside.is_file():
        return lanes_of_map(beside.read_bytes(), str(beside))
    return []
