"""A strict translator of the vehicles' compiled code from Python to WebAssembly.

The kernels are scalar functions for numba: loops over lanes, arithmetic on floats, and arrays of known shape.
This module translates the same source to WebAssembly, so that a browser computes what Python computes. All
operations are those of IEEE 754 in double precision and in the order of the source, so the results are equal
to the bit. Whatever the translator does not know is an error, never a guess.

Functions are compiled for the types of their arguments, as numba does. The shapes of all arrays are known, so
an array is one address, and the arrays that a function makes have fixed places in the memory.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

from accelerated_evaluation.publishing.explorer import wasm
from accelerated_evaluation.publishing.explorer.kinds import WORD, ArrayOf, RecordOf, Type
from accelerated_evaluation.publishing.explorer.statements import Body
from accelerated_evaluation.publishing.explorer.wasm import Function


@dataclass
class Translator:
    """Translates functions and collects them in one module of WebAssembly.

    Attributes
    ----------
    functions
        The translated functions, callees before their callers.
    memory
        Bytes of the memory in use. The first word stays free.
    """

    functions: list[Function] = field(default_factory=list)
    memory: int = WORD
    _known: dict[tuple, tuple[int, Type | None]] = field(default_factory=dict)
    _exports: dict[str, int] = field(default_factory=dict)

    def allocate(self, kind: ArrayOf | RecordOf) -> int:
        """Return the address of new memory for an array or a record."""
        address, self.memory = self.memory, self.memory + kind.size
        return address

    def export(self, name: str, function: Callable, *types: Type) -> None:
        """Translate a function for arguments of given types, and export it under a name."""
        self._exports[name] = self.translated(function, types)[0]

    def translated(self, function: Callable, types: Sequence[Type]) -> tuple[int, Type | None]:
        """Return the index of a function for given types of arguments, and the type of its result."""
        source = getattr(function, "py_func", function)
        key = (source, *types)
        if key not in self._known:
            body = Body(self, source, types)
            body.translate()
            self.functions.append(body.function)
            self._known[key] = len(self.functions) - 1, body.result
        return self._known[key]

    def module(self) -> bytes:
        """Return the binary module."""
        return wasm.module(self.functions, self._exports, self.memory)
