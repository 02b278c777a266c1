"""Styles of the methods in all figures. Any two methods differ in their colour and in a further property."""

from collections.abc import Mapping
from typing import Any

from accelerated_evaluation.methods import METHODS


def style_of(method: str, *parts: str) -> Mapping[str, Any]:
    """Return the Matplotlib style of a method: the given properties, such as ``"color"``, or all of them."""
    style = METHODS[method].style
    return {part: style[part] for part in parts or style}
