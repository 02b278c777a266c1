"""Vehicles in a trace of ASAM OSI: their numbers, classes and lengths, and the trailers that they pull."""

from collections import Counter
from collections.abc import Sequence
from math import inf
from typing import TYPE_CHECKING

import numpy as np
import pandas as pd

from accelerated_evaluation.base.arrays import Array

if TYPE_CHECKING:  # an optional extra
    from betterosi import MovingObject

TRAILERS = ("TRAILER", "SEMITRAILER")
BESIDE = 1.5  # [m], largest distance of a trailer from the axis of the vehicle that pulls it
LANE = "a lane"


class Fleet:
    """The vehicles of a trace so far.

    Identifiers of OSI have 64 bits without a sign, and may be used again for another object. The vehicles are
    therefore numbered in the order in which they appear. An identifier that was absent for longer than
    ``gap`` [ms] gets a new number. Lanes are numbered, too.
    """

    def __init__(self, gap: int) -> None:
        self.identifiers: list[int] = []  # of each number
        self.classes: list[str | None] = []
        self.lengths: list[float] = []  # [m]
        self.driven: dict[int, tuple[float, float, float]] = {}  # distance and last position [m], by number
        # Number of positions of vehicles without each of the things that are needed.
        self.missing = Counter({"position": 0, "orientation": 0, "velocity": 0, LANE: 0})
        # Sums of the products of the speeds [m/s] with the velocities along the yaw, and with themselves.
        self.ahead, self.speed = 0.0, 0.0
        self.others = 0  # number of positions of objects that are not vehicles
        self.has_boundaries = False  # whether the trace has boundaries of lanes
        self._gap = gap
        self._latest: dict[int, tuple[int, int]] = {}  # number and time of the last message, by identifier
        self._lanes: dict[int, int] = {}
        self._pulled_by: dict[int, int] = {}  # numbers of trailers and of the vehicles that pull them

    def number(self, one: "MovingObject", time: int, length: float) -> int:
        """Return the number of a vehicle of a length [m] that is in view at a time [ms]."""
        number, latest = self._latest.get(one.id.value, (-1, -inf))
        if time - latest > self._gap:
            number = len(self.identifiers)
            self.identifiers.append(one.id.value)
            self.classes.append(None)
            self.lengths.append(length)
        if self.classes[number] is None and one.vehicle_classification:
            self.classes[number] = one.vehicle_classification.type.name
        self._latest[one.id.value] = number, time
        return number

    def lane(self, identifier: int | None) -> int | None:
        """Return the number of a lane, None for no lane."""
        return None if identifier is None else self._lanes.setdefault(identifier, len(self._lanes))

    def owners(
        self, vehicles: Sequence["MovingObject"], numbers: Sequence[int], along: Array, across: Array
    ) -> list[int]:
        """Return the index of the vehicle to which each object belongs: its own, or for a trailer another.

        A trailer belongs to the vehicle that names it. If none does, it belongs to the nearest vehicle that
        was straight ahead when it was first seen. Row i and column j of ``along`` and ``across`` [m] say how
        far object i is ahead and to the left of object j.
        """
        owners = [*range(len(vehicles))]
        by_identifier = {one.id.value: i for i, one in enumerate(vehicles)}
        for i, one in enumerate(vehicles):
            kind = one.vehicle_classification
            if kind and kind.trailer_id:
                named = by_identifier.get(kind.trailer_id.value, i)
                if kind.has_trailer or self.classes[numbers[named]] in TRAILERS:
                    owners[named] = i
        place = {number: i for i, number in enumerate(numbers)}
        for i, number in enumerate(numbers):
            if owners[i] == i and self.classes[number] in TRAILERS:
                ahead = np.where((along[:, i] > 0) & (np.abs(across[:, i]) <= BESIDE), along[:, i], np.inf)
                if number not in self._pulled_by and np.isfinite(ahead.min()):
                    self._pulled_by[number] = numbers[int(ahead.argmin())]
                owners[i] = place.get(self._pulled_by.get(number, number), i)
        for _ in range(3):  # a trailer may have a trailer
            owners = [owners[owner] for owner in owners]
        return owners

    def identified(self, candidates: pd.DataFrame) -> pd.DataFrame:
        """Return changes of lane whose vehicles and hosts have the identifiers of the trace, not numbers."""
        known = {
            key: [None if pd.isna(one) else self.identifiers[int(one)] for one in candidates[key]]
            for key in ("vehicle", "host")
        }
        return candidates.assign(
            **{key: pd.Series(of, index=candidates.index, dtype=object) for key, of in known.items()}
        )
