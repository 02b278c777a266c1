"""Conversion of a state to JSON and back, with checks of the types and ranges of all values."""

from dataclasses import fields, is_dataclass
from types import UnionType
from typing import Any, get_args, get_origin, get_type_hints

import numpy as np
from fewruns.constants import POOL, REACH
from fewruns.progress import Batch

# Errors that are raised if the contents of a file are not a valid state.
MISFIT = (KeyError, TypeError, ValueError, OverflowError, AttributeError, StopIteration)

# Smallest and largest number of some fields. Numbers outside would cause an error only later, in use.
LARGEST = float(np.finfo(float).max)
RANGES = {
    **dict.fromkeys(("wide_draws", "searched", "learnt_at"), (0, 1e12)),
    **dict.fromkeys(("sites", "probability", "controlled", "controlled_square"), (-1e100, 1e100)),
    **dict.fromkeys(("z", "centres", "kept", "directions"), (-1e6, 1e6)),
    "axes": (-1.001, 1.001),  # with a margin for rounding
    "dimension": (1, 1e6),
    "batch_size": (1, POOL // 4),
    **dict.fromkeys(("theta", "graded_theta"), (-20, 20)),  # logarithms of lengths, amplitude and noise
    "rarest": (0, REACH),
    **dict.fromkeys(("weight", "kept_weight"), (0, 1e100)),
    "inclusion": (1e-100, 1.001),  # with a margin for rounding
    **dict.fromkeys(("control", "kept_control", "foreseen"), (0, 1)),
}


def encode(value: Any) -> Any:  # noqa: ANN401
    """Return a value as dictionaries, lists and numbers; the dictionary of a batch also names its class."""
    if is_dataclass(value):
        plain = {item.name: encode(getattr(value, item.name)) for item in fields(value)}
        return {"kind": type(value).__name__} | plain if isinstance(value, Batch) else plain
    if isinstance(value, dict):
        return {key: encode(item) for key, item in value.items()}
    if isinstance(value, list):
        return [encode(item) for item in value]
    return value.tolist() if isinstance(value, np.ndarray | np.generic) else value


def decode(annotation: Any, value: Any) -> Any:  # noqa: ANN401
    """Return the value that `encode` converted.

    Parameters
    ----------
    annotation
        Type of the value: a dataclass, an array type, a list type, or the type of a number or text.
    value
        The result of `encode`.

    Raises
    ------
    ValueError
        If the value does not have this type, or a number is outside of `RANGES`. Other errors of `MISFIT` may
        be raised for contents that `encode` cannot have written.
    """
    if isinstance(annotation, UnionType):  # a batch, or something that may be None
        if value is None and type(None) in get_args(annotation):
            return None
        choices = [choice for choice in get_args(annotation) if choice is not type(None)]
        name = value["kind"] if len(choices) > 1 else choices[0].__name__
        return decode(next(choice for choice in choices if choice.__name__ == name), value)
    if is_dataclass(annotation):
        types = get_type_hints(annotation)
        return annotation(**{name: _within(name, decode(types[name], value[name])) for name in types})
    kind = get_origin(annotation) or annotation
    if kind is np.ndarray:
        return _array(value, get_args(get_args(annotation)[1])[0])
    if type(value) is not kind and (type(value), kind) != (int, float):
        raise ValueError(f"{value!r:.40} where a value of the type {kind.__name__} was expected")
    return [decode(get_args(annotation)[0], item) for item in value] if kind is list else kind(value)


def _array(value: Any, kind: type) -> np.ndarray:  # noqa: ANN401
    """Return a list as an array of flags or of numbers."""
    array = np.array(value)
    if not isinstance(value, list) or (
        array.size and array.dtype.kind not in ("b" if kind is np.bool_ else "iuf")
    ):
        raise ValueError(f"{value!r:.40} where a list of type {kind.__name__} was expected")
    return array.astype(kind)


def _within(name: str, value: Any) -> Any:  # noqa: ANN401
    """Return the value of a field; raise ValueError if it is outside of the range of this field."""
    if isinstance(value, int | float | np.ndarray):
        low, high = RANGES.get(name, (-LARGEST, LARGEST))
        if not np.all((np.asarray(value) >= low) & (np.asarray(value) <= high)):  # true for NaN as well
            raise ValueError(f"{name} outside of {low:g} to {high:g}")
    return value
