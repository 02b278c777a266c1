"""Sensitivity of the crash probability to choices about the model, the data and the cap on closing speeds."""

import math
import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np
import pandas as pd
from tqdm import tqdm

from accelerated_evaluation.base.arrays import Array
from accelerated_evaluation.base.errors import StudyError
from accelerated_evaluation.base.sections import OR_AUTO, SHARE, listed, section
from accelerated_evaluation.crash_map.exact import ALL, Exact, exact_probabilities
from accelerated_evaluation.crash_map.mapping import map_crashes
from accelerated_evaluation.crash_map.maps import CrashMap
from accelerated_evaluation.laws.distributions import PiecewiseMixture
from accelerated_evaluation.laws.paper.models import IndependentLaw, recorded_lead_speeds
from accelerated_evaluation.laws.paper.piecewise import (
    EXPONENTIAL,
    PieceFamily,
    fit_piecewise,
    knots_at_quantiles,
    usable_knots,
)
from accelerated_evaluation.records.segments import assign_segments
from accelerated_evaluation.vehicles.protocol import Vehicle

SPEED = {"type": "number", "minimum": 0, "maximum": 100}  # [m/s], as an element of a list
SECTION = section(
    inverse_ttc_knots=listed(
        [0.9, 0.925, 0.95, 0.975, 0.99, 0.995],
        SHARE,
        "Quantiles for the knot of TTC^-1 that are tried in turn.",
    ),
    inverse_range_knots=listed(
        [0.6, 0.7, 0.8, 0.9, 0.95],
        SHARE,
        "Quantiles for the knot of R^-1 with two pieces that are tried in turn.",
    ),
    lead_speed_edges=listed(
        [[5, 35], [5, 20, 35], [5, 10, 15, 20, 25, 30, 35]],
        {"type": "array", "minItems": 2, "items": SPEED},
        "Segmentations of v_L [m/s] that are tried in turn.",
        **OR_AUTO,
    ),
    closing_speed_max=listed(
        [18, 20, 22, 25, 30],
        {"type": "number", "exclusiveMinimum": 0, "maximum": 100},
        "Caps on the closing speed [m/s] that are tried in turn.",
        **OR_AUTO,
    ),
)


@dataclass(frozen=True)
class Levels:
    """The choices of a piecewise model that are made again when the model is fitted to other data.

    Knots are described by their quantile levels in the data.
    """

    inverse_range: tuple[float, ...]  # of the knots of R^-1, in increasing order
    inverse_ttc: float  # of the knot of TTC^-1 in every segment
    pieces_of_range: PieceFamily  # families of the pieces of R^-1
    body: PieceFamily  # family of the body of TTC^-1
    tail: PieceFamily  # family of its tail

    @classmethod
    def of(cls, model: IndependentLaw) -> "Levels":
        """Return the choices of a fitted model.

        The level of the knot of TTC^-1 is the weight of the body, averaged over the segments. The weights of
        the segments may differ because of ties in the data.
        """
        bodies = [law.weights[0] * model.counts[segment] for segment, law in model.inverse_ttc.items()]
        # A segment with few rows may have a simpler family. The refit tries the most complex family of all
        # segments.
        fitted = [[PieceFamily.of(piece) for piece in law.components] for law in model.inverse_ttc.values()]
        body, tail = (
            max(families, key=lambda family: (family != EXPONENTIAL, family.components))
            for families in zip(*fitted, strict=True)
        )
        return cls(
            tuple(np.cumsum(model.inverse_range.weights[:-1]).tolist()),
            sum(bodies) / sum(model.counts.values()),
            PieceFamily.of(model.inverse_range.components[0]),
            body,
            tail,
        )


def fit_for_crashes(
    encounters: pd.DataFrame,
    levels: Levels,
    range_max: float,
    smallest_inverse_ttc: float,
    closing_speed_max: float,
) -> IndependentLaw:
    """Return a fitted piecewise model that is used only to compute its crash probability.

    If there are no crashes below the knot of TTC^-1, the crash probability depends only on the weight of the
    body. The body is then fitted by an exponential instead of the normal mixture, whose fit takes seconds.
    ``smallest_inverse_ttc`` [1/s] is that of all crashes of the crash map, and ``closing_speed_max`` a cap
    [m/s].
    """

    def inverse_ttc(x: Array) -> PiecewiseMixture:
        knots = usable_knots(x, knots_at_quantiles(x, [levels.inverse_ttc]))
        body = EXPONENTIAL if knots[0] <= smallest_inverse_ttc else levels.body
        return fit_piecewise(x, 0.0, knots, [body, levels.tail])

    inverse_range = encounters["inverse_range"].to_numpy()
    families = [levels.pieces_of_range] * (len(levels.inverse_range) + 1)
    knots = usable_knots(inverse_range, knots_at_quantiles(inverse_range, levels.inverse_range))
    groups = encounters.groupby("segment", observed=True)["inverse_ttc"]
    counts = {segment: len(rows) for segment, rows in groups}
    return IndependentLaw(
        "refit",
        counts,
        fit_piecewise(inverse_range, 1 / range_max, knots, families),
        {segment: inverse_ttc(rows.to_numpy()) for segment, rows in groups},
        recorded_lead_speeds(encounters, counts),
        closing_speed_max,
    )


@dataclass(frozen=True)
class Refit:
    """Refits of a piecewise model, whose crash probabilities are computed with one crash map."""

    crash_map: CrashMap
    smallest_inverse_ttc: float  # of all crashes [1/s]
    closing_speed_max: float  # cap [m/s]

    @classmethod
    def by(cls, crash_map: CrashMap, closing_speed_max: float) -> "Refit":
        """Return refits of a model that use a given crash map and cap on closing speeds [m/s].

        The smallest TTC^-1 of a crash is computed once, because all refits need it.
        """
        return cls(crash_map, crash_map.smallest_inverse_ttc(), closing_speed_max)

    def probability(self, encounters: pd.DataFrame, levels: Levels) -> Exact:
        """Fit a model to encounters, and return its crash probability over all segments."""
        range_max = self.crash_map.grid.range_max
        law = fit_for_crashes(
            encounters, levels, range_max, self.smallest_inverse_ttc, self.closing_speed_max
        )
        return exact_probabilities(self.crash_map, law)[ALL]


@contextmanager
def warning_of_failure(what: str) -> Iterator[None]:
    """Convert the failure of a refit (`StudyError`) into a warning, so that the other refits are made."""
    try:
        yield
    except StudyError as error:
        warnings.warn(f"{what}: no refit, because {error}", stacklevel=3)


def is_repeated(encounters: pd.DataFrame) -> Array:
    """Return which rows of a table are equal to the row before them, shape (n,)."""
    return (encounters == encounters.shift()).all(axis=1).to_numpy()


def study_sensitivity(
    crash_map: CrashMap,
    models: Mapping[str, IndependentLaw],
    variant: str,
    encounters: pd.DataFrame,
    settings: Mapping[str, Any],
) -> pd.DataFrame:
    """Tabulate the crash probability over all segments for models that are refitted with one other choice.

    ``settings`` has quantile levels, lists of edges of segments [m/s], and ``outlier_rows``, rows of the
    encounter table, counted from 1, to leave out. If a choice leaves too few rows for a fit, its probability
    is NaN, and a warning gives the reason.
    """
    base = Levels.of(models[variant])
    refit = Refit.by(crash_map, models[variant].closing_speed_max)
    rows: list[tuple[str, str, Exact]] = [
        ("model", name, exact_probabilities(crash_map, model)[ALL]) for name, model in models.items()
    ]
    cases: list[tuple[str, str, Callable[[], pd.DataFrame], Levels]] = []

    def as_recorded() -> pd.DataFrame:
        return encounters

    for level in settings["inverse_ttc_knots"]:
        cases.append(("knot of TTC^-1", f"{level:g}", as_recorded, replace(base, inverse_ttc=level)))
    for level in settings["inverse_range_knots"]:
        levels = replace(base, inverse_range=(level,))
        cases.append(("knot of R^-1, two pieces", f"{level:g}", as_recorded, levels))
    for edges in settings["lead_speed_edges"]:
        name = " ".join(f"{edge:g}" for edge in edges)
        cases.append(("segments of v_L", name, partial(assign_segments, encounters, edges), base))
    cases.append(("repeated rows", "drop", lambda: encounters[~is_repeated(encounters)], base))
    if settings["outlier_rows"]:
        outliers = encounters.index[np.array(settings["outlier_rows"]) - 1]
        cases.append(("outliers", "drop", partial(encounters.drop, outliers), base))
    for choice, value, table, levels in tqdm(cases, desc="sensitivity", unit=" refits"):
        exact = Exact(math.nan, math.nan)
        with warning_of_failure(f"{choice}, {value}"):
            exact = refit.probability(table(), levels)
        rows.append((choice, value, exact))
    return _table(rows)


def study_cap(
    vehicle: Vehicle,
    crash_map: CrashMap,
    law: IndependentLaw,
    caps: Sequence[float],
    generator: np.random.Generator,
) -> pd.DataFrame:
    """Tabulate the crash probability for several caps on closing speeds.

    A crash map is computed for each cap. The columns are ``choice``, ``value`` (the cap), ``probability`` and
    ``standard_error``.
    """
    rows = []
    for cap in caps:
        other = map_crashes(vehicle, replace(crash_map.grid, closing_speed_max=cap), [], generator)
        exact = exact_probabilities(other, replace(law, closing_speed_max=cap))[ALL]
        rows.append(("closing-speed cap [m/s]", f"{cap:g}", exact))
    return _table(rows)


def _table(rows: list[tuple[str, str, Exact]]) -> pd.DataFrame:
    columns = ["choice", "value", "probability", "standard_error"]
    values = [(choice, value, exact.probability, exact.standard_error) for choice, value, exact in rows]
    return pd.DataFrame(values, columns=columns)
