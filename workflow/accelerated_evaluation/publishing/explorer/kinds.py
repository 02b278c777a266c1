"""Types of values in the translated code, and the error for code that cannot be translated."""

import math
from dataclasses import dataclass

from accelerated_evaluation.base.errors import InputError
from accelerated_evaluation.publishing.explorer.wasm import F64, I32, V128

WORD = 8  # bytes of every value in the memory

FLOAT, INT, BOOL = "float", "int", "bool"
FLOATS, BOOLS = "two floats", "two truths"  # of two lanes, which are computed at once
SCALARS = {FLOAT: F64, INT: I32, BOOL: I32, FLOATS: V128, BOOLS: V128}


@dataclass(frozen=True)
class ArrayOf:
    """An array, or a column of one: its elements, `FLOAT` or `INT`, shape, and distances in elements."""

    element: str
    shape: tuple[int, ...]
    strides: tuple[int, ...]

    @classmethod
    def of(cls, *shape: int, element: str = FLOAT) -> "ArrayOf":
        """Return a contiguous array with one or two dimensions."""
        return cls(element, shape, (1,) if len(shape) == 1 else (shape[1], 1))

    @property
    def size(self) -> int:
        """Bytes in the memory."""
        return WORD * math.prod(self.shape)


@dataclass(frozen=True)
class RecordOf:
    """A named tuple of numbers: the names of its fields, and whether each is `FLOAT`, `INT` or `BOOL`."""

    fields: tuple[tuple[str, str], ...]

    @classmethod
    def of(cls, named_tuple: type) -> "RecordOf":
        """Return the record of a class of named tuples."""
        return cls(tuple((name, kind.__name__) for name, kind in named_tuple.__annotations__.items()))

    @property
    def size(self) -> int:
        """Bytes in the memory."""
        return WORD * len(self.fields)


Type = str | ArrayOf | RecordOf | tuple


class TranslationError(InputError):
    """Code outside the part of Python that the translator knows."""

    def __init__(self, where: str, seen: str, expected: str = "") -> None:
        change = "Use operations that publishing/explorer translates, or teach it this one."
        super().__init__(where, seen=seen, expected=expected or "the supported part of Python", change=change)


INSTRUCTIONS = {FLOAT: "f64", INT: "i32", BOOL: "i32", FLOATS: "f64x2", BOOLS: "v128"}


def load(element: str) -> str:
    """Return the instruction that loads an element."""
    return "v128.load" if element == FLOATS else f"{INSTRUCTIONS[element]}.load"


def store(element: str) -> str:
    """Return the instruction that stores an element."""
    return "v128.store" if element == FLOATS else f"{INSTRUCTIONS[element]}.store"
