"""Distances to the vehicle ahead that a recording contains, compared with those computed from positions.

Data sets in the same format may differ in what a position means: in highD `x` is the left end of the bounding
box, in AD4CHE its centre, and in files from SUMO the front of the vehicle. The distances in the file itself
show which it is. The readings differ by half or all of the difference of the lengths of two vehicles, so only
pairs of a long and a short vehicle can show it.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from accelerated_evaluation.base.errors import InputError
from accelerated_evaluation.records.recordings.cut_ins import AGREEMENT

if TYPE_CHECKING:
    from duckdb import DuckDBPyConnection

# ``h`` is the frame of a vehicle, ``f`` that of the vehicle ahead, and ``m`` its row in ``meta``. A distance
# has the median error in the frames of a pair of vehicles, so that positions that jump do not decide. The
# pairs are those whose lengths differ by more than half of the largest difference.
COMPARED = """
    WITH compared AS (
        SELECT h.id, f.id AS ahead, abs(f.{length} - h.{length}) AS differ, h.own_gap,
            h.own_headway * abs(h.velocity) / h.own_gap AS headway,
            CASE WHEN abs(h.velocity) - abs(f.velocity) > 1 AND h.own_ttc > 0
                THEN h.own_ttc * (abs(h.velocity) - abs(f.velocity)) / h.own_gap END AS ttc,
            [{gaps}] AS gaps
        FROM frames AS h JOIN frames AS f ON f.id = h.ahead AND f.time = h.time JOIN meta AS m ON m.id = f.id
        WHERE h.own_gap > 0
    ), pairs AS (
        SELECT {of_pair} FROM compared GROUP BY id, ahead
        HAVING max(differ) >= (SELECT max(differ) FROM compared) / 2
    )
    SELECT {of_all}, (SELECT median(headway) FROM compared), (SELECT median(ttc) FROM compared) FROM pairs
"""
TOLERANCE = 0.5  # [m], largest median error of a distance that counts as the same


@dataclass(frozen=True)
class OwnColumns:
    """The columns of a format with the number of the vehicle ahead, and the distance, time and TTC to it."""

    ahead: str
    gap: str
    headway: str
    ttc: str
    length: str  # column of ``frames`` with the length of a vehicle
    difference: str  # SQL expression of the difference of the positions of two vehicles, which may be ``gap``

    def sql(self, header: Sequence[str]) -> str:
        """Return the SQL of the columns ``ahead``, ``own_gap``, ``own_headway`` and ``own_ttc`` of frames.

        They are NULL if the file does not have the column, or if a cell is not a number.
        """
        names = {"ahead": self.ahead, "own_gap": self.gap, "own_headway": self.headway, "own_ttc": self.ttc}
        return ", ".join(
            f"{f'TRY_CAST({name} AS DOUBLE)' if name in header else 'CAST(NULL AS DOUBLE)'} AS {key}"
            for key, name in names.items()
        )


def compared(
    connection: "DuckDBPyConnection", where: str, readings: Mapping[str, str], columns: OwnColumns
) -> tuple[str | None, list[str]]:
    """Return the reading of the positions that the distances of a recording support, and warnings.

    ``readings`` maps the name of each reading to the SQL expression of the gap to the vehicle ahead. The
    reading is None if the distances do not distinguish them: if the file has none, or if they are differences
    of positions, as in highD. A warning says that headways or TTC of the file contradict its positions and
    speeds. InputError is raised if the distances contradict the positions under all readings, because it is
    then unknown where a vehicle begins.
    """
    to_front = f" + f.{columns.length}"  # the distance may end at the rear of the vehicle ahead, or its front
    gaps = [f"({gap}){more}" for gap in readings.values() for more in ("", to_front)]
    gaps.append(columns.difference)
    places = range(1, len(gaps) + 1)
    query = COMPARED.format(
        length=columns.length,
        gaps=", ".join(gaps),
        of_pair=", ".join(f"median(abs(own_gap - gaps[{place}])) AS e{place}" for place in places),
        of_all=", ".join(f"median(e{place})" for place in places),
    )
    *found, of_difference, headway, ttc = connection.execute(query).fetchone()
    if of_difference is None:
        return None, []
    best = dict(zip(readings, map(min, found[::2], found[1::2]), strict=True))
    warnings = [
        f"{column} of the recordings is about {ratio:.3g} times what {columns.gap} and the speeds give"
        for column, ratio in ((columns.headway, headway), (columns.ttc, ttc))
        if ratio is not None and not 1 / AGREEMENT <= ratio <= AGREEMENT
    ]
    smallest = min(best, key=best.__getitem__)
    if min(best[smallest], of_difference) > TOLERANCE:
        raise InputError(
            f"{where}, column {columns.gap}",
            seen=f"distances that differ by {best[smallest]:.3g} m from those computed from positions and "
            "lengths, between vehicles of the most different lengths",
            expected="distances to the vehicle ahead [m], and positions that are the "
            + ", the ".join(readings),
            change=f"Correct the positions or {columns.gap}. Leave {columns.gap} out only if it is wrong and "
            f"positions are the {next(iter(readings))}.",
        )
    return smallest if best[smallest] < of_difference else None, warnings
