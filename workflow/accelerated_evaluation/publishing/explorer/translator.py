"""A strict translator of the vehicles' compiled code from Python to WebAssembly.

The simulation code of the vehicles, the kernels, consists of functions that numba compiles: loops over lanes,
which are encounters that are simulated side by side, arithmetic on floats, and arrays of known shape. This
module translates the same source to WebAssembly, so that a browser computes the same outcomes as Python. All
operations are those of IEEE 754 in double precision, in the order of the source, so the results are equal bit
by bit. If the source uses a part of Python that is not supported, `TranslationError` is raised.

As by numba, a function is compiled separately for each combination of argument types. The shapes of all
arrays are known, so an array is passed as one address, and an array that a function creates has a fixed place
in the memory.
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
        Number of bytes of the memory that are in use, including a first word that is never used.
    """

    functions: list[Function] = field(default_factory=list)
    memory: int = WORD
    _known: dict[tuple, tuple[int, Type | None]] = field(default_factory=dict)
    _exports: dict[str, int] = field(default_factory=dict)

    def allocate(self, kind: ArrayOf | RecordOf) -> int:
        """Reserve memory for an array or a record, and return its address in bytes."""
        address, self.memory = self.memory, self.memory + kind.size
        return address

    def export(self, name: str, function: Callable, *types: Type) -> None:
        """Translate a function for given types of its arguments, and export the result under a name."""
        self._exports[name] = self.translated(function, types)[0]

    def translated(self, function: Callable, types: Sequence[Type]) -> tuple[int, Type | None]:
        """Translate a function for given argument types, unless this has been done before.

        Returns
        -------
        index, result
            Index of the function in the module, and the type of its result: None without a result, a tuple
            for several.
        """
        source = getattr(function, "py_func", function)
        key = (source, *types)
        if key not in self._known:
            body = Body(self, source, types)
            body.translate()
            self.functions.append(body.function)
            self._known[key] = len(self.functions) - 1, body.result
        return self._known[key]

    def module(self) -> bytes:
        """Return the WebAssembly module in its binary format."""
        return wasm.module(self.functions, self._exports, self.memory)
