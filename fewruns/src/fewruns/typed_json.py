"""Values of dataclasses as JSON, and back with the types of their annotations."""

import hashlib
import json
from collections import ChainMap
from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from functools import cache
from types import NoneType, UnionType
from typing import Annotated, Any, Union, get_args, get_origin, get_type_hints

import numpy as np

_Sizes = ChainMap[str, Any]
# Errors that `decode` raises if a value has not been written by `encode`.
MISFIT = (LookupError, TypeError, ValueError, OverflowError, AttributeError)


def encode(value: Any) -> Any:  # noqa: ANN401
    """Return a value as dictionaries, lists, numbers and texts."""
    if is_dataclass(value):
        return {item.name: encode(getattr(value, item.name)) for item in fields(value)}
    if isinstance(value, dict):
        return {key: encode(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [encode(item) for item in value]
    return value.tolist() if isinstance(value, np.ndarray | np.generic) else value


def decode(annotation: Any, value: Any, sizes: _Sizes | None = None) -> Any:  # noqa: ANN401
    """Return the value of a given type that `encode` converted; raise an error of `MISFIT` if it is another.

    In a union of dataclasses, the names of the fields decide. ``sizes`` are known lengths of axes by name.
    """
    origin, parts = get_origin(annotation) or annotation, get_args(annotation)
    if origin is Annotated:
        return _array(parts[0], parts[1:], value, _Sizes({}) if sizes is None else sizes)
    if origin in (Union, UnionType):
        choices = [kind for kind in parts if kind is not NoneType]
        if value is None and len(choices) < len(parts):
            return None
        return decode(choices[0] if len(choices) == 1 else _with_fields(choices, value), value, sizes)
    if isinstance(annotation, type) and is_dataclass(annotation):
        types, known = _types(annotation), _Sizes({}, sizes or {})
        known.update({name: value[name] for name, kind in types.items() if kind is int})
        return annotation(**{name: decode(kind, value[name], known) for name, kind in types.items()})
    if origin in (list, tuple) and isinstance(value, list):
        return origin(decode(parts[0], item, sizes) for item in value)
    if type(value) is not origin and (type(value), origin) != (int, float):
        raise ValueError(f"{value!r:.40} where a value of the type {origin.__name__} was expected")
    if origin is dict and parts:
        return {decode(parts[0], key): decode(parts[1], item, sizes) for key, item in value.items()}
    return origin(value)


@cache
def _types(kind: type) -> dict[str, Any]:
    """Return the types of the fields of a dataclass by name."""
    hints = get_type_hints(kind, include_extras=True)
    return {item.name: hints[item.name] for item in fields(kind)}


def _with_fields(choices: list[type], value: Mapping[str, Any]) -> type:
    """Return the dataclass whose fields have the names of the keys of ``value``."""
    return next((kind for kind in choices if _types(kind).keys() == value.keys()), choices[0])


def _array(kind: Any, axes: tuple, value: Any, sizes: ChainMap) -> np.ndarray:  # noqa: ANN401
    """Return a list as an array with the given axes; lengths of new axes are added to ``sizes``."""
    dtype = get_args(get_args(kind)[1])[0]
    array, kinds = np.array(value), {type(item) for item in np.array(value, dtype=object).flat}
    is_other = not kinds <= ({bool} if dtype is np.bool_ else {int, float})  # NumPy makes [true, 0.5] numbers
    if not isinstance(value, list) or is_other or array.dtype.kind not in "biuf":
        raise ValueError(f"{value!r:.40} where a list of type {dtype.__name__} was expected")
    known = [axis if isinstance(axis, int) else sizes.get(axis) for axis in axes]
    if array.shape == (0,):  # an empty list has lost the lengths of the other axes
        array = array.reshape(0, *(length or 0 for length in known[1:]))
    shape = array.shape
    if len(shape) != len(axes) or any(k not in (None, n) for k, n in zip(known, shape, strict=True)):
        raise ValueError(f"the shape {shape} where {axes} was expected, with {dict(sizes)}")
    sizes.update({axis: n for axis, n in zip(axes, shape, strict=True) if isinstance(axis, str)})
    return array.astype(dtype)


def checksum(plain: Any) -> str:  # noqa: ANN401
    """Return a digest of the result of `encode`, which does not depend on the layout of the file."""
    text = json.dumps(plain, sort_keys=True, separators=(",", ":"))
    return hashlib.sha256(text.encode()).hexdigest()
