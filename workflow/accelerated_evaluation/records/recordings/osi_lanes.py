"""Lanes of the vehicles in a trace of ASAM OSI."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from accelerated_evaluation.base.arrays import Array
from accelerated_evaluation.records.recordings.lanes import CentreLines, Piece, joined_lanes
from accelerated_evaluation.records.recordings.opendrive import lanes_of_map

if TYPE_CHECKING:  # an optional extra
    from betterosi import GroundTruth, Lane, MovingObject

MAP_TOPICS = ["/ground_truth_map", "ground_truth_map"]  # channels of a map in a trace of omega-prime


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
