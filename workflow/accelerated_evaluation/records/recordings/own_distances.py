"""Distances to the vehicle ahead that a recording contains, compared with those computed from positions.

Data sets in the same format may differ in what a position means: in highD `x` is the left end of the bounding
box, and in AD4CHE its centre. The distances in the file itself show which of the two it is.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from accelerated_evaluation.records.recordings.cut_ins import AGREEMENT

if TYPE_CHECKING:
    from duckdb import DuckDBPyConnection

# ``h`` is the frame of a vehicle, ``f`` that of the vehicle ahead, and ``m`` its row in ``meta``. Positions
# that jump by metres shall not decide, so an error counts as at most 5 m.
COMPARED = """
    SELECT {errors}, median(h.own_headway * abs(h.velocity) / h.own_gap) AS headway,
        median(h.own_ttc * (abs(h.velocity) - abs(f.velocity)) / h.own_gap)
            FILTER (abs(h.velocity) - abs(f.velocity) > 1 AND h.own_ttc > 0) AS ttc
    FROM frames AS h JOIN frames AS f ON f.id = h.ahead AND f.time = h.time JOIN meta AS m ON m.id = f.id
    WHERE h.own_gap > 0
"""
ERROR = "avg(least(abs(h.own_gap - ({gap})), 5))"
TOLERANCE = 0.5  # [m], largest mean error of a distance that counts as the same


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
    connection: "DuckDBPyConnection", readings: Mapping[str, str], columns: OwnColumns
) -> tuple[str | None, list[str]]:
    """Return the reading of the positions that the distances of a recording support, and warnings.

    ``readings`` maps the name of each reading to the SQL expression of the gap to the vehicle ahead. The
    reading is None if the distances do not distinguish them: if the file has none, if all vehicles are
    equally long, or if they are differences of positions, as in highD. A warning says that the distances,
    headways or TTC of the file contradict its positions and speeds under all readings.
    """
    to_front = f" + f.{columns.length}"  # the distance may end at the rear of the vehicle ahead, or its front
    gaps = [f"({gap}){more}" for gap in readings.values() for more in ("", to_front)]
    errors = ", ".join(ERROR.format(gap=gap) for gap in [*gaps, columns.difference])
    *found, of_difference, headway, ttc = connection.execute(COMPARED.format(errors=errors)).fetchone()
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
        what = (
            f"{columns.gap} of the recordings differs by {best[smallest]:.3g} m from the distances computed"
        )
        return None, [f"{what} from positions and lengths, on average", *warnings]
    others = [error for name, error in best.items() if name != smallest]
    is_clear = best[smallest] <= min([of_difference, *others]) / 2
    return smallest if is_clear else None, warnings
