"""Translation of the statements of one function to WebAssembly.

Each method ``do_X`` appends the code for a statement X of Python's syntax tree.
"""

import ast
import inspect
import textwrap
from collections.abc import Callable, Sequence

from accelerated_evaluation.publishing.explorer.calls import Calls
from accelerated_evaluation.publishing.explorer.kinds import (
    BOOL,
    INT,
    SCALARS,
    WORD,
    ArrayOf,
    TranslationError,
    Type,
    load,
    store,
)


class Body(Calls):
    """The translation of the statements of one Python function to WebAssembly.

    Parameters
    ----------
    module
        Translator that also translates the functions that this one calls.
    source
        The Python function.
    types
        Types of its arguments.
    """

    def translate(self) -> None:
        """Translate all statements of the function.

        Raises
        ------
        TranslationError
            If the function uses a part of Python that the translator does not support.
        """
        lines, self.first_line = inspect.getsourcelines(self.source)
        tree = ast.parse(textwrap.dedent("".join(lines))).body[0]
        names = [argument.arg for argument in tree.args.args]
        if len(names) != len(self.types):
            raise self.error(tree, f"{len(self.types)} arguments", f"{len(names)} arguments")
        for name, kind in zip(names, self.types, strict=True):
            self.variables[name] = self.new_local(kind), kind
        self.statements(tree.body)
        if self.result is not None:
            self.emit("unreachable")  # a function with a result does not reach its end

    def statements(self, nodes: Sequence[ast.stmt]) -> None:
        """Translate statements in order."""
        for node in nodes:
            translate = getattr(self, f"do_{type(node).__name__}", None)
            if translate is None:
                raise self.error(node, f"a statement {type(node).__name__}")
            translate(node)

    def require_one_lane(self, node: ast.stmt) -> None:
        """Raise TranslationError if the statement is in a loop that computes two rounds at once."""
        if self.lane is not None:
            raise self.error(node, f"a statement {type(node).__name__} in a loop of two lanes")

    def do_Expr(self, node: ast.Expr) -> None:  # noqa: N802
        """Translate a statement that is only an expression, such as a call whose result is not used.

        A docstring is skipped.
        """
        if isinstance(node.value, ast.Constant) and isinstance(node.value.value, str):
            return
        self.require_one_lane(node)
        kind = self.value(node.value)
        for _ in kind if isinstance(kind, tuple) else () if kind is None else (kind,):
            self.emit("drop")

    def do_Assign(self, node: ast.Assign) -> None:  # noqa: N802
        """Translate an assignment: all values are computed before the first is stored."""
        if len(node.targets) == 1 and isinstance(node.targets[0], ast.Name):
            self.store(node.targets[0], self.value(node.value))
            return
        values = self.temporaries(node, node.value)
        for target in node.targets:
            parts = target.elts if isinstance(target, ast.Tuple) else [target]
            if len(parts) != len(values):
                raise self.error(node, f"{len(values)} values for {len(parts)} names", "equal numbers")
            for part, (local, kind) in zip(parts, values, strict=True):
                self.assign(part, local, kind)

    def temporaries(self, node: ast.AST, value: ast.expr) -> list[tuple[int, Type]]:
        """Evaluate an expression, and store its value in new local variables.

        There is one variable for each element of a tuple, and for each element of a column that is assigned
        to a tuple of names.

        Returns
        -------
        list
            Index and type of each local variable.
        """
        if isinstance(value, ast.Tuple):
            return [self.temporaries(node, part)[0] for part in value.elts]
        kind = self.value(value)
        if isinstance(kind, tuple):
            locals_ = [self.new_local(part) for part in kind]
            for local in reversed(locals_):
                self.emit("local.set", local)
            return list(zip(locals_, kind, strict=True))
        if kind is None:
            raise self.error(node, "a function without a result", "a value")
        local = self.new_local(kind)
        self.emit("local.set", local)
        unpacked = isinstance(node, ast.Assign) and isinstance(node.targets[0], ast.Tuple)
        if isinstance(kind, ArrayOf) and unpacked and value is node.value:
            return [self.element_at(local, kind, index) for index in range(kind.shape[0])]
        return [(local, kind)]

    def element_at(self, array: int, kind: ArrayOf, index: int) -> tuple[int, Type]:
        """Add code that loads an element of an array into a new local variable.

        Parameters
        ----------
        array
            Index of the local variable that contains the address of the array.
        kind
            Type of the array.
        index
            Index of the element along the first axis.

        Returns
        -------
        tuple
            Index of the new local variable, and its type.
        """
        local = self.new_local(kind.element)
        self.emit("local.get", array)
        self.emit(load(kind.element), WORD * kind.strides[0] * index)
        self.emit("local.set", local)
        return local, kind.element

    def assign(self, target: ast.expr, local: int, kind: Type) -> None:
        """Assign the value of a local variable of type ``kind`` to a name, an element or a column."""
        if isinstance(target, ast.Name):
            self.emit("local.get", local)
            self.store(target, kind)
            return
        if not isinstance(target, ast.Subscript):
            raise self.error(target, f"an assignment to {ast.unparse(target)}", "a name or an element")
        array, offset = self.address(target)
        if isinstance(array, ArrayOf):  # a column: every element
            column = self.new_local(INT)
            self.emit("local.set", column)
            for index in range(array.shape[0]):
                self.emit("local.get", column)
                if isinstance(kind, ArrayOf):
                    self.emit("local.get", self.element_at(local, kind, index)[0])
                else:
                    self.emit("local.get", local)
                    self.convert(target, kind, array.element)
                self.emit(store(array.element), WORD * array.strides[0] * index)
            return
        self.emit("local.get", local)
        self.convert(target, kind, array)
        self.emit(store(array), offset)

    def store(self, target: ast.Name, kind: Type | None) -> None:
        """Store the value on WebAssembly's stack in a variable; the first value determines its type.

        Raises
        ------
        TranslationError
            If the value is not a single one, or if one of two rounds that are computed at once would change a
            variable that both use.
        """
        if kind is None or isinstance(kind, tuple):
            raise self.error(target, "no single value", "one value for one name")
        if self.lane is not None and target.id in self.outside:
            raise self.error(target, f"{target.id} from one lane to the next", "a variable of each lane")
        if target.id not in self.variables:
            self.variables[target.id] = self.new_local(kind), kind
        local, known = self.variables[target.id]
        self.convert(target, kind, known)
        self.emit("local.set", local)

    def do_AugAssign(self, node: ast.AugAssign) -> None:  # noqa: N802
        """Translate ``a += b`` as ``a = a + b``."""
        value = ast.BinOp(node.target, node.op, node.value)
        self.do_Assign(ast.fix_missing_locations(ast.copy_location(ast.Assign([node.target], value), node)))

    def do_If(self, node: ast.If) -> None:  # noqa: N802
        """Translate ``if`` and ``else``."""
        self.expect(node.test, BOOL)
        self.open("if")
        self.statements(node.body)
        if node.orelse:
            self.emit("else")
            self.statements(node.orelse)
        self.close()

    def do_While(self, node: ast.While) -> None:  # noqa: N802
        """Translate a ``while`` loop."""
        self.require_one_lane(node)
        self.loop(lambda: self.expect(node.test, BOOL), node, _nothing, _nothing)

    def do_For(self, node: ast.For) -> None:  # noqa: N802
        """Translate a ``for`` loop over a range, whose ends are evaluated once.

        If the step is 1 and no round depends on an earlier one, the code computes two rounds at once as long
        as two are left. A second loop computes the remaining rounds one by one.
        """
        call = node.iter
        self.require_one_lane(node)
        if not (isinstance(call, ast.Call) and isinstance(call.func, ast.Name) and call.func.id == "range"):
            raise self.error(node, f"a loop over {ast.unparse(call)}", "a loop over a range")
        if not isinstance(node.target, ast.Name):
            raise self.error(node, "several counters", "one counter")
        first, end, *rest = [ast.Constant(0), *call.args] if len(call.args) == 1 else call.args
        counter, last = self.new_local(INT), self.new_local(INT)
        for expression, local in ((first, counter), (end, last)):
            self.expect(expression, INT)
            self.emit("local.set", local)
        if not rest:
            self.in_pairs(node, counter, last)
        self.counted(node, counter, last, self.constant(rest[0]) if rest else 1)

    def in_pairs(self, node: ast.For, counter: int, last: int) -> None:
        """Translate a loop that computes two rounds at once, if all its statements allow it.

        Otherwise no code is added, and the loop over single rounds, which follows, computes all of them.

        Parameters
        ----------
        node
            The loop.
        counter, last
            Indices of the local variables with the next number and the end of the range.
        """
        before = len(self.function.code), len(self.function.local_types), dict(self.variables), self.depth
        loops, lane = list(self.loops), self.lane
        try:
            self.lane, self.outside = node.target.id, set(self.variables)
            self.counted(node, counter, last, 2)
        except TranslationError:
            del self.function.code[before[0] :], self.function.local_types[before[1] :]
            self.depth, self.loops = before[3], loops
        finally:
            self.lane, self.variables = lane, before[2]

    def counted(self, node: ast.For, counter: int, last: int, step: int) -> None:
        """Translate a loop that starts at the value of ``counter`` and ends before ``last``.

        Parameters
        ----------
        node
            The loop.
        counter, last
            Indices of the local variables with the next number and the end of the range.
        step
            Increment of the counter; 2 for two rounds at once, where a last odd round is left over.
        """

        def test() -> None:
            self.emit("local.get", counter)
            self.emit("local.get", last)
            if self.lane is not None:
                self.emit("i32.const", step - 1)
                self.emit("i32.sub")
            self.emit("i32.lt")

        def begin() -> None:
            self.emit("local.get", counter)
            if node.target.id not in self.variables:
                self.variables[node.target.id] = self.new_local(INT), INT
            self.emit("local.set", self.variables[node.target.id][0])

        def advance() -> None:
            self.emit("local.get", counter)
            self.emit("i32.const", step)
            self.emit("i32.add")
            self.emit("local.set", counter)

        self.loop(test, node, advance, begin)

    def loop(
        self,
        test: Callable[[], None],
        node: ast.While | ast.For,
        advance: Callable[[], None],
        begin: Callable[[], None],
    ) -> None:
        """Add the code of a loop, as a block, a loop and a block that are nested.

        ``break`` leaves the outer block, and ``continue`` leaves the inner one.

        Parameters
        ----------
        test
            Function that adds the code that leaves on WebAssembly's stack whether the loop continues.
        node
            The loop, whose statements are translated.
        advance
            Function that adds the code after each round, which increments the counter.
        begin
            Function that adds the code before each round, which sets the variable of the loop.
        """
        if node.orelse:
            raise self.error(node, "a loop with else")
        self.open("block")
        outer = self.depth
        self.open("loop")
        again = self.depth
        test()
        self.emit("i32.eqz")
        self.emit("br_if", self.depth - outer)
        begin()
        self.open("block")
        self.loops.append((outer, self.depth))
        self.statements(node.body)
        self.loops.pop()
        self.close()
        advance()
        self.emit("br", self.depth - again)
        self.close()
        self.close()

    def open(self, name: str, *result: int) -> None:
        """Open a block of instructions with the instruction ``block``, ``loop`` or ``if``.

        Parameters
        ----------
        name
            Name of the instruction.
        result
            Type of the value that the block leaves on the stack, if any.
        """
        self.emit(name, *result)
        self.depth += 1

    def close(self) -> None:
        """Close the block that was opened last with `open`."""
        self.emit("end")
        self.depth -= 1

    def do_Break(self, node: ast.Break) -> None:  # noqa: N802
        """Translate ``break``, which leaves the innermost loop."""
        self.require_one_lane(node)
        self.emit("br", self.depth - self.loops[-1][0])

    def do_Continue(self, node: ast.Continue) -> None:  # noqa: N802
        """Translate ``continue``, which begins the next round of the innermost loop."""
        self.require_one_lane(node)
        self.emit("br", self.depth - self.loops[-1][1])

    def do_Return(self, node: ast.Return) -> None:  # noqa: N802
        """Translate ``return`` with no value, a number, or a tuple of numbers.

        Raises
        ------
        TranslationError
            If two statements return different types, or an array is returned.
        """
        self.require_one_lane(node)
        kind: Type | None = None
        if isinstance(node.value, ast.Tuple):
            kind = tuple(self.value(part) for part in node.value.elts)
        elif node.value is not None:
            kind = self.value(node.value)
            expected = self.result
            if isinstance(expected, str) and isinstance(kind, str):
                self.convert(node, kind, expected)
                kind = expected
        if self.function.results and kind != self.result:
            raise self.error(node, f"results {self.result} and {kind}", "results of one type")
        self.result = kind
        parts = kind if isinstance(kind, tuple) else () if kind is None else (kind,)
        if not all(isinstance(part, str) for part in parts):
            raise self.error(node, "an array as a result", "numbers")
        self.function.results = [SCALARS[part] for part in parts]
        self.emit("return")


def _nothing() -> None:
    """Write no code before or after a round of a ``while`` loop."""
