"""How each method is drawn in all figures. No two methods are told apart by colour alone."""

from collections.abc import Mapping
from typing import Any

_LOOKS = {
    "single": {"color": "#b2182b", "linestyle": "--", "marker": "s"},
    "piecewise": {"color": "#08306b", "linestyle": "-", "marker": "o"},
    "heuristic": {"color": "#41ab5d", "linestyle": "-.", "marker": "^"},
    "crude": {"color": "#777777", "linestyle": ":", "marker": "v"},
    "surrogate": {"color": "#6a3d9a", "linestyle": (0, (3, 1, 1, 1)), "marker": "D"},
}


def look_of(method: str, *parts: str) -> Mapping[str, Any]:
    """Return how a method is drawn, or only some parts of it, such as ``"color"``."""
    look = _LOOKS[method]
    return {part: look[part] for part in parts or look}
