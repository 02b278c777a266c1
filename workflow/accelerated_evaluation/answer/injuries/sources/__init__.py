"""Published curves of the risk of injury: one module a publication, one registry.

A curve counts for the driver of the car under test if it is for frontal impacts, and for the driver of the
car that cuts in if it is for impacts from behind.
"""

from collections.abc import Callable

from accelerated_evaluation.answer.injuries.curves import RiskCurve, Source
from accelerated_evaluation.base.registry import Registry

SOURCES: Registry[Callable[[], Source]] = Registry("source of injury risk curves", __name__, __path__)


def published_curves(level: str, impact: str) -> dict[str, RiskCurve]:
    """Return all published curves for a level of injury and the struck end of a car, by source."""
    sources = [SOURCES[name]() for name in SOURCES]
    return {
        source.name: source.curves[level, impact] for source in sources if (level, impact) in source.curves
    }
