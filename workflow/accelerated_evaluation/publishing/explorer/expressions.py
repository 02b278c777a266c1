"""Translation of the expressions of one function to WebAssembly.

WebAssembly is a stack machine: the code of an expression leaves its value on the stack. Each method ``of_X``
appends the code for a node X of Python's syntax tree, and returns the type of the value.

A loop over encounters computes two of them, two lanes, at once where possible. A value then has the type
`FLOATS` or `BOOLS`, with a number or a Boolean for each lane.
"""

import ast
import builtins
from collections.abc import Callable, Sequence
from types import ModuleType
from typing import TYPE_CHECKING, Any

from accelerated_evaluation.publishing.explorer import wasm
from accelerated_evaluation.publishing.explorer.kinds import (
    BOOL,
    BOOLS,
    FLOAT,
    FLOATS,
    INSTRUCTIONS,
    INT,
    SCALARS,
    WORD,
    RecordOf,
    TranslationError,
    Type,
    load,
)
from accelerated_evaluation.publishing.explorer.wasm import I32, Function

if TYPE_CHECKING:
    from accelerated_evaluation.publishing.explorer.translator import Translator

ARITHMETIC = {ast.Add: "add", ast.Sub: "sub", ast.Mult: "mul"}
COMPARISONS = {ast.Lt: "lt", ast.LtE: "le", ast.Gt: "gt", ast.GtE: "ge", ast.Eq: "eq", ast.NotEq: "ne"}
VECTORS = {FLOAT: FLOATS, INT: FLOATS, BOOL: BOOLS}


class Expressions:
    """The state of the translation of a function, and the translation of its expressions.

    Parameters
    ----------
    module
        Translator that also translates the functions that this one calls.
    source
        The Python function.
    types
        Types of its arguments.
    """

    def __init__(self, module: "Translator", source: Callable, types: Sequence[Type]) -> None:
        self.module, self.source, self.types = module, source, types
        self.result: Type | None = None
        self.function = Function([SCALARS.get(kind, I32) for kind in types])
        self.variables: dict[str, tuple[int, Type]] = {}
        self.depth, self.first_line = 0, 1
        self.lane: str | None = None  # name of the counter in a loop that computes two lanes at once
        self.outside: set[str] = set()  # variables that were assigned before this loop, and that lanes share
        self.loops: list[tuple[int, int]] = []  # per loop: depths of the blocks that break and continue leave

    def error(self, node: ast.AST, seen: str, expected: str = "") -> TranslationError:
        """Return a `TranslationError` that names the function and the line of a part of its source."""
        line = self.first_line + getattr(node, "lineno", 1) - 1
        where = f"{self.source.__module__}.{self.source.__name__}, line {line}"
        return TranslationError(where, seen, expected)

    def emit(self, name: str, *operands: int | float) -> None:
        """Append a WebAssembly instruction, given by its name and operands, to the code of the function."""
        self.function.code += wasm.instruction(name, *operands)

    def new_local(self, kind: Type) -> int:
        """Add a local variable of a type to the function, and return its index."""
        self.function.local_types.append(SCALARS.get(kind, I32))
        return len(self.function.local_types) - 1

    def value(self, node: ast.expr) -> Type | None:
        """Translate an expression, and return its type.

        The type is a tuple for a call with several results, and None for a call without a result.

        Raises
        ------
        TranslationError
            If the expression is of a kind that cannot be translated.
        """
        translate = getattr(self, f"of_{type(node).__name__}", None)
        if translate is None:
            raise self.error(node, ast.unparse(node))
        return translate(node)

    def expect(self, node: ast.expr, kind: str) -> None:
        """Translate an expression, and convert its value to the type ``kind``."""
        self.convert(node, self.value(node), kind)

    def convert(self, node: ast.AST, kind: Type | None, expected: Type) -> None:
        """Convert the value on WebAssembly's stack from type ``kind`` to type ``expected``.

        An integer or a Boolean becomes a float, and a single value becomes a value for each of two lanes (two
        encounters that are computed at once).

        Raises
        ------
        TranslationError
            If the types differ, and the conversion is not one of these.
        """
        if kind in SCALARS and VECTORS.get(kind) == expected:
            self.function.code += _spread(kind)
        elif expected == FLOAT and kind in (INT, BOOL):
            self.emit("f64.convert_i32")
        elif kind != expected:
            raise self.error(node, f"{ast.unparse(node)} of type {kind}", f"type {expected}")

    def of_Constant(self, node: ast.Constant) -> Type:  # noqa: N802
        """Translate a literal number, and return its type."""
        return self.number(node, node.value)

    def number(self, node: ast.expr, value: object) -> Type:
        """Add code that leaves a constant on WebAssembly's stack, and return the type of the constant.

        Parameters
        ----------
        node
            The expression, for an error message.
        value
            The constant.
        """
        kind = type(value).__name__
        if kind not in SCALARS:
            raise self.error(node, f"{ast.unparse(node)}, a {kind}", "a number, a variable or a function")
        self.emit("f64.const" if kind == FLOAT else "i32.const", value)
        return kind

    def of_Name(self, node: ast.Name) -> Type:  # noqa: N802
        """Translate a local variable, or a constant of the module, and return its type."""
        if node.id in self.variables:
            if node.id == self.lane:
                raise self.error(node, f"the number {node.id} of a lane", "no number in a loop of two lanes")
            local, kind = self.variables[node.id]
            self.emit("local.get", local)
            return kind
        return self.number(node, self.object(node))

    def of_Attribute(self, node: ast.Attribute) -> Type:  # noqa: N802
        """Translate the field of a record, or a constant such as ``np.inf``, and return its type."""
        if isinstance(node.value, ast.Name) and node.value.id in self.variables:
            local, kind = self.variables[node.value.id]
            names = [name for name, _ in kind.fields] if isinstance(kind, RecordOf) else []
            if node.attr not in names:
                raise self.error(node, ast.unparse(node), "a field of a record")
            place = names.index(node.attr)
            self.emit("local.get", local)
            self.emit(load(kind.fields[place][1]), WORD * place)
            return kind.fields[place][1]
        return self.number(node, self.object(node))

    def object(self, node: ast.expr) -> Any:  # noqa: ANN401
        """Return the Python object of a global name, or of an attribute of a module such as ``np.floor``."""
        if isinstance(node, ast.Name):
            known = vars(builtins) | self.source.__globals__
            if node.id in known and node.id not in self.variables:
                return known[node.id]
        if isinstance(node, ast.Attribute) and isinstance(module := self.object(node.value), ModuleType):
            return getattr(module, node.attr)
        raise self.error(node, ast.unparse(node), "a variable with a value, or a name of the module")

    def constant(self, node: ast.expr) -> Any:  # noqa: ANN401
        """Return the value of a constant integer or of a tuple of constant integers."""
        if isinstance(node, ast.Tuple):
            return tuple(self.constant(part) for part in node.elts)
        value = node.value if isinstance(node, ast.Constant) else self.object(node)
        if not isinstance(value, int):
            raise self.error(node, ast.unparse(node), "a constant integer")
        return value

    def of_UnaryOp(self, node: ast.UnaryOp) -> Type:  # noqa: N802
        """Translate the negative of a float or the negation of a Boolean, and return its type."""
        kind = self.value(node.operand)
        if isinstance(node.op, ast.USub) and kind in (FLOAT, FLOATS):
            self.emit(f"{INSTRUCTIONS[kind]}.neg")
        elif isinstance(node.op, ast.Not | ast.Invert) and kind in (BOOL, BOOLS):
            self.emit("i32.eqz" if kind == BOOL else "v128.not")
        else:
            raise self.error(node, ast.unparse(node), "the negative of a float, or the negation of a truth")
        return kind

    def pair(
        self, first: ast.expr, second: ast.expr, *, to_float: bool = False, to_lanes: bool = False
    ) -> Type:
        """Translate two operands, convert them to a common type, and return this type.

        The common type is a float if one operand is a float. The type has a value for each lane (one of two
        encounters that are computed at once) if one of the operands has.

        Parameters
        ----------
        first, second
            The operands, in the order in which their values are put on WebAssembly's stack.
        to_float
            Convert two integers to floats, as a division needs.
        to_lanes
            Give each lane a value, even if both operands are single values.
        """
        left = self.value(first)
        here = len(self.function.code)
        right = self.value(second)
        kinds = {left, right}
        lanes = to_lanes or not kinds.isdisjoint((FLOATS, BOOLS))
        common = FLOAT if FLOAT in kinds or (to_float and kinds == {INT}) else left
        if lanes:
            common = BOOLS if kinds <= {BOOL, BOOLS} else FLOATS
        if left != common:
            after, self.function.code = self.function.code[here:], self.function.code[:here]
            self.convert(first, left, common)
            self.function.code += after
        self.convert(second, right, common)
        if common not in SCALARS:
            raise self.error(first, ast.unparse(first), "a number")
        return common

    def of_BinOp(self, node: ast.BinOp) -> Type:  # noqa: N802
        """Translate an operation on two values, and return the type of the result.

        The operations are ``+``, ``-``, ``*`` and ``/``, ``%`` of integers, and ``&`` and ``|`` of Booleans.
        """
        operation = type(node.op)
        kind = self.pair(node.left, node.right, to_float=operation is ast.Div)
        if operation in (ast.BitAnd, ast.BitOr) and kind in (BOOL, BOOLS):
            self.emit(f"{INSTRUCTIONS[kind]}.{'and' if operation is ast.BitAnd else 'or'}")
        elif operation is ast.Div and kind in (FLOAT, FLOATS):
            self.emit(f"{INSTRUCTIONS[kind]}.div")
        elif operation is ast.Mod and kind == INT:  # equals Python's % for integers that are not negative
            self.emit("i32.rem")
        elif operation in ARITHMETIC and kind not in (BOOL, BOOLS):
            self.emit(f"{INSTRUCTIONS[kind]}.{ARITHMETIC[operation]}")
        else:
            raise self.error(node, f"{ast.unparse(node)} of type {kind}")
        return kind

    def of_Compare(self, node: ast.Compare) -> Type:  # noqa: N802
        """Translate a comparison of two numbers, and return its type.

        The type is a Boolean, or a Boolean for each of two encounters that are computed at once.
        """
        if len(node.ops) > 1 or type(node.ops[0]) not in COMPARISONS:
            raise self.error(node, ast.unparse(node), "one comparison of numbers")
        kind = self.pair(node.left, node.comparators[0])
        if kind == BOOLS:
            raise self.error(node, ast.unparse(node), "a comparison of numbers")
        self.emit(f"{INSTRUCTIONS[kind]}.{COMPARISONS[type(node.ops[0])]}")
        return BOOLS if kind == FLOATS else BOOL

    def of_BoolOp(self, node: ast.BoolOp) -> Type:  # noqa: N802
        """Translate ``and`` or ``or``, and return the type. Later operands are evaluated only if needed."""
        *others, last = node.values
        for part in others:
            self.expect(part, BOOL)
            self.emit("if", I32)
            if isinstance(node.op, ast.Or):
                self.emit("i32.const", 1)
                self.emit("else")
        self.expect(last, BOOL)
        for _ in others:
            if isinstance(node.op, ast.And):
                self.emit("else")
                self.emit("i32.const", 0)
            self.emit("end")
        return BOOL

    def of_IfExp(self, node: ast.IfExp) -> Type:  # noqa: N802
        """Translate ``a if test else b``, and return its type. Unlike in Python, both values are computed."""
        tested = self.value(node.test)
        if tested not in (BOOL, BOOLS):
            raise self.error(node.test, ast.unparse(node.test), "a truth")
        chosen = self.new_local(tested)
        self.emit("local.set", chosen)
        kind = self.pair(node.body, node.orelse, to_lanes=tested == BOOLS)
        self.emit("local.get", chosen)
        if tested == BOOLS:
            self.emit("v128.bitselect")
        elif kind in (FLOATS, BOOLS):
            self.function.code += wasm.SELECT_VECTOR
        else:
            self.emit("select")
        return kind


def _spread(kind: str) -> bytes:
    """Return the code that replaces the number on the stack by a vector with this number in both lanes."""
    if kind == BOOL:  # 1 becomes -1, all of whose bits are 1
        parts = [("i32.const", -1), ("i32.mul",), ("i32x4.splat",)]
    else:
        parts = [("f64.convert_i32",)] * (kind == INT) + [("f64x2.splat",)]
    return b"".join(wasm.instruction(*part) for part in parts)
