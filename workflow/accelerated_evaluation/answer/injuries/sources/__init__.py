"""Published curves of the risk of injury; each publication is a module, and `SOURCES` is their registry.

Curves for frontal impacts are used for the driver of the car under test, and curves for impacts from behind
for the driver of the car that cuts in.
"""

from collections.abc import Callable

from accelerated_evaluation.answer.injuries.curves import RiskCurve, Source
from accelerated_evaluation.base.registry import Registry

SOURCES: Registry[Callable[[], Source]] = Registry("source of injury risk curves", __name__, __path__)


def published_curves(level: str, impact: str) -> dict[str, RiskCurve]:
    """Return the published curves for a level of injury and a struck end of a car, by name of the source."""
    sources = [SOURCES[name]() for name in SOURCES]
    return {
        source.name: source.curves[level, impact] for source in sources if (level, impact) in source.curves
    }
