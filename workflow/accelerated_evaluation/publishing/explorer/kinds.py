"""Types of values in the translated code, and the error for code that cannot be translated."""

import math
from dataclasses import dataclass

from accelerated_evaluation.base.errors import InputError
from accelerated_evaluation.publishing.explorer.wasm import F64, I32, V128

WORD = 8  # bytes that every value takes in the memory, also an integer or a truth

FLOAT, INT, BOOL = "float", "int", "bool"
FLOATS, BOOLS = "two floats", "two truths"  # a vector with a value for each of two lanes
SCALARS = {FLOAT: F64, INT: I32, BOOL: I32, FLOATS: V128, BOOLS: V128}


@dataclass(frozen=True)
class ArrayOf:
    """Type of an array, or of a column of an array.

    Attributes
    ----------
    element
        Type of its elements, `FLOAT` or `INT`.
    shape
        Number of elements along each dimension.
    strides
        Distance of neighbours along each dimension, in elements.
    """

    element: str
    shape: tuple[int, ...]
    strides: tuple[int, ...]

    @classmethod
    def of(cls, *shape: int, element: str = FLOAT) -> "ArrayOf":
        """Return the type of a contiguous array with one or two dimensions."""
        return cls(element, shape, (1,) if len(shape) == 1 else (shape[1], 1))

    @property
    def size(self) -> int:
        """Number of bytes that the array takes in the memory."""
        return WORD * math.prod(self.shape)


@dataclass(frozen=True)
class RecordOf:
    """Type of a named tuple of numbers.

    Attributes
    ----------
    fields
        Name and type, `FLOAT`, `INT` or `BOOL`, of each field.
    """

    fields: tuple[tuple[str, str], ...]

    @classmethod
    def of(cls, named_tuple: type) -> "RecordOf":
        """Return the type for a class of named tuples, whose annotations are float, int or bool."""
        return cls(tuple((name, kind.__name__) for name, kind in named_tuple.__annotations__.items()))

    @property
    def size(self) -> int:
        """Number of bytes that the record takes in the memory."""
        return WORD * len(self.fields)


Type = str | ArrayOf | RecordOf | tuple


class TranslationError(InputError):
    """Raised for code that uses a part of Python that the translator does not support."""

    def __init__(self, where: str, seen: str, expected: str = "") -> None:
        change = "Use operations that publishing/explorer translates, or add a translation of this one."
        super().__init__(where, seen=seen, expected=expected or "the supported part of Python", change=change)


INSTRUCTIONS = {FLOAT: "f64", INT: "i32", BOOL: "i32", FLOATS: "f64x2", BOOLS: "v128"}


def load(element: str) -> str:
    """Return the name of the instruction that loads a value of the given type from the memory."""
    return "v128.load" if element == FLOATS else f"{INSTRUCTIONS[element]}.load"


def store(element: str) -> str:
    """Return the name of the instruction that stores a value of the given type in the memory."""
    return "v128.store" if element == FLOATS else f"{INSTRUCTIONS[element]}.store"
