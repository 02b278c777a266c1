"""Styles of the methods in all figures. Any two methods differ in more than colour."""

from collections.abc import Mapping
from typing import Any

from accelerated_evaluation.methods import METHODS


def style_of(method: str, *parts: str) -> Mapping[str, Any]:
    """Return how a method is drawn, or only some parts of it, such as ``"color"``."""
    style = METHODS[method].style
    return {part: style[part] for part in parts or style}
