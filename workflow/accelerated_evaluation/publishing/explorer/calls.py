"""Translation of calls, and of elements of arrays, to WebAssembly."""

import ast
from collections.abc import Callable

import numpy as np

from accelerated_evaluation.publishing.explorer import wasm
from accelerated_evaluation.publishing.explorer.expressions import Expressions
from accelerated_evaluation.publishing.explorer.kinds import (
    FLOAT,
    FLOATS,
    INSTRUCTIONS,
    INT,
    WORD,
    ArrayOf,
    Type,
    load,
)


class Calls(Expressions):
    """The expressions of a function, with its calls and elements of arrays."""

    def of_Call(self, node: ast.Call) -> Type | None:  # noqa: N802
        """Translate a call of min, max, abs, int, np.floor or np.empty, or of another compiled function.

        Returns
        -------
        Type
            Type of the result; a tuple for several results, None for a function that returns nothing.
        """
        called = self.object(node.func)
        if node.keywords:
            raise self.error(node, ast.unparse(node), "arguments without names")
        if called is np.empty:
            return self.empty(node)
        if called in (min, max) and len(node.args) == 2:
            return self.extreme(node, "lt" if called is min else "gt")
        if called in (abs, np.floor, int) and len(node.args) == 1:
            kind = self.value(node.args[0])
            if called is int and kind == FLOAT:
                self.function.code += wasm.TRUNCATE
                return INT
            if called is int or kind not in (FLOAT, FLOATS):
                raise self.error(node, f"{ast.unparse(node)} of type {kind}", "a float")
            self.emit(f"{INSTRUCTIONS[kind]}.{'abs' if called is abs else 'floor'}")
            return kind
        if not hasattr(called, "py_func"):
            raise self.error(node, ast.unparse(node), "min, max, abs, int, np.floor, or a compiled function")
        types = [self.value(argument) for argument in node.args]
        if self.lane is not None and any(isinstance(kind, ArrayOf) for kind in types):
            raise self.error(node, ast.unparse(node), "no arrays as arguments in a loop of two lanes")
        index, result = self.module.translated(called, types)
        self.emit("call", index)
        return result

    def extreme(self, node: ast.Call, comparison: str) -> Type:
        """Translate ``min`` or ``max`` of two values, and return the type of the result.

        As in Python, the result is the first value unless the second is smaller (``min``) or larger
        (``max``), which matters for NaN. Pairs of floats, for two encounters that are computed at once, have
        instructions of their own.

        Parameters
        ----------
        node
            The call.
        comparison
            ``"lt"`` for ``min``, ``"gt"`` for ``max``.
        """
        kind = self.pair(*node.args)
        if kind == FLOATS:
            self.emit("f64x2.pmin" if comparison == "lt" else "f64x2.pmax")
            return kind
        first, second = self.new_local(kind), self.new_local(kind)
        self.emit("local.set", second)
        self.emit("local.set", first)
        for local in (second, first, second, first):
            self.emit("local.get", local)
        self.emit(f"{INSTRUCTIONS[kind]}.{comparison}")
        self.emit("select")
        return kind

    def empty(self, node: ast.Call) -> Type:
        """Translate ``np.empty`` with a constant shape, and return the type of the array.

        The array has a fixed place in the memory. Its address is left on WebAssembly's stack.
        """
        shape = self.constant(node.args[0])
        of_integers = len(node.args) == 2 and self.object(node.args[1]) is np.int64
        if len(node.args) > 1 + of_integers:
            raise self.error(node, ast.unparse(node), "an array of float or np.int64")
        sizes = shape if isinstance(shape, tuple) else (shape,)
        kind = ArrayOf.of(*sizes, element=INT if of_integers else FLOAT)
        self.emit("i32.const", self.module.allocate(kind))
        return kind

    def of_Subscript(self, node: ast.Subscript) -> Type:  # noqa: N802
        """Translate an element or a column of an array, or a result of a function, and return its type."""
        if isinstance(node.value, ast.Call):
            kinds, place = self.value(node.value), self.constant(node.slice)
            if not isinstance(kinds, tuple) or not 0 <= place < len(kinds):
                raise self.error(node, ast.unparse(node), "a part of a tuple")
            for _ in kinds[place + 1 :]:
                self.emit("drop")
            kept = self.new_local(kinds[place])
            self.emit("local.set", kept)
            for _ in kinds[:place]:
                self.emit("drop")
            self.emit("local.get", kept)
            return kinds[place]
        kind, offset = self.address(node)
        if isinstance(kind, str):
            self.emit(load(kind), offset)
        return kind

    def address(self, node: ast.Subscript) -> tuple[Type, int]:
        """Add code that leaves the address of an element or a column of an array on WebAssembly's stack.

        Returns
        -------
        type, offset
            Type of the element or the column, and the number of bytes that is still to be added to the
            address; instructions that load and store take it as an operand.
        """
        name = node.value.id if isinstance(node.value, ast.Name) else ""
        local, kind = self.variables.get(name, (0, None))
        if not isinstance(kind, ArrayOf):
            raise self.error(node, ast.unparse(node), "an element of an array")
        indices = node.slice.elts if isinstance(node.slice, ast.Tuple) else [node.slice]
        if len(indices) != len(kind.shape):
            raise self.error(node, f"{len(indices)} indices", f"{len(kind.shape)} indices")
        *row, column = indices
        whole = bool(row) and isinstance(row[0], ast.Slice)
        if whole and any((row[0].lower, row[0].upper, row[0].step)):
            raise self.error(node, ast.unparse(node), "a whole column")
        self.emit("local.get", local)
        element = kind.element
        if isinstance(column, ast.Name) and column.id == self.lane and row and element == FLOAT:
            self.add_scaled(lambda: self.emit("local.get", self.variables[column.id][0]), kind.strides[-1])
            element = FLOATS
        else:
            self.add_scaled(lambda: self.expect(column, INT), kind.strides[-1])
        if whole:
            return ArrayOf(kind.element, kind.shape[:1], kind.strides[:1]), 0
        if row and isinstance(row[0], ast.Name) and row[0].id not in self.variables:
            return element, WORD * kind.strides[0] * self.constant(row[0])  # needs no arithmetic
        if row:
            self.add_scaled(lambda: self.expect(row[0], INT), kind.strides[0])
        return element, 0

    def add_scaled(self, push: Callable[[], None], stride: int) -> None:
        """Add code that increases the address on WebAssembly's stack by an index times a stride.

        Parameters
        ----------
        push
            Function that adds the code that leaves the index on the stack.
        stride
            Number of elements of the array between neighbouring indices.
        """
        push()
        self.emit("i32.const", WORD * stride)
        self.emit("i32.mul")
        self.emit("i32.add")
