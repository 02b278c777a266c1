"""What the tests of several packages build alike."""

import math

from accelerated_evaluation import Grid
from accelerated_evaluation.laws.distributions import BoundedExponential, Empirical, PiecewiseMixture
from accelerated_evaluation.laws.paper.models import IndependentLaw
from hypothesis import HealthCheck, settings


def coarse_grid(speeds=(5, 35, 6), ranges=(75, 20), closing=(45.0, 120), refinement=2) -> Grid:
    """Return a grid with few cells; ``speeds`` has limits and cells, and the others a limit and cells."""
    limits = dict(zip(("lead_speed_min", "lead_speed_max", "lead_speed_cells"), speeds, strict=True))
    limits |= dict(zip(("range_max", "range_cells"), ranges, strict=True))
    limits |= dict(zip(("closing_speed_max", "closing_speed_points"), closing, strict=True))
    return Grid(**limits, refinement=refinement)


def repeatable(examples: int) -> settings:
    """Return the settings of a property that is tested with the same examples each time."""
    unchecked = [HealthCheck.function_scoped_fixture, HealthCheck.too_slow]
    own = {"derandomize": True, "deadline": None, "database": None, "suppress_health_check": unchecked}
    return settings(max_examples=examples, **own)


def two_laws(counts: dict[str, int]) -> dict[str, IndependentLaw]:
    """Return the laws ``single`` and ``piecewise``, each with one distribution for all variables."""
    pieces = BoundedExponential(1.0, 0.0, 1.0), BoundedExponential(1.0, 1.0, math.inf)
    speeds = dict.fromkeys(counts, Empirical([10.0]))
    return {
        name: IndependentLaw("made up", counts, law, dict.fromkeys(counts, law), speeds)
        for name, law in (
            ("single", BoundedExponential(5.0)),
            ("piecewise", PiecewiseMixture((0.5, 0.5), pieces)),
        )
    }
