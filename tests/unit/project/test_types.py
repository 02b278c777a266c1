"""The type hints: the ratchet of mypy, and what an editor shows to callers."""

import ast
import inspect
import re
from pathlib import Path

import accelerated_evaluation as ae
import mypy_ratchet
import pytest

OUTPUT = """
workflow/a/one.py:3: error: Argument 1 to "f" has incompatible type "str"; expected "int"  [arg-type]
workflow/a/one.py:3: note: a note is no error
workflow/a/one.py:9:5: error: Name "x" is not defined  [name-defined]
workflow/ab.py:1: error: Need type annotation for "x"  [var-annotated]
"""


def test_errors_are_counted_by_file():
    assert mypy_ratchet.errors_of(OUTPUT) == {"workflow/a/one.py": 2, "workflow/ab.py": 1}


@pytest.mark.parametrize(
    ("clean", "allowed", "words"),
    [
        ((), 3, None),
        (("workflow/ab",), 3, None),  # the folder ab, not the module ab.py
        (("workflow/a",), 3, r"workflow/a/one.py \(2\)"),
        (("workflow/ab.py",), 3, r"workflow/ab.py \(1\)"),
        ((), 2, "3 errors .* at most 2"),
        ((), 4, "Set ELSEWHERE to 3"),
    ],
)
def test_the_ratchet_refuses_what_is_worse_and_asks_for_what_is_better(clean, allowed, words):
    wrong = mypy_ratchet.judged(mypy_ratchet.errors_of(OUTPUT), clean, allowed)
    assert wrong is None if words is None else re.search(words, wrong)


def test_every_entry_of_the_list_exists_so_that_none_is_silently_unchecked():
    for each in mypy_ratchet.CLEAN:
        assert (mypy_ratchet.ROOT / each).exists(), each


def test_the_types_of_callers_are_those_of_the_public_functions():
    """Names, order and defaults of the parameters, without which an editor would accept another call."""
    stub = ast.parse(Path(ae.__file__).with_suffix(".pyi").read_text(encoding="utf-8"))
    imported = [name.asname for part in stub.body if isinstance(part, ast.ImportFrom) for name in part.names]
    own = [part for part in stub.body if isinstance(part, ast.FunctionDef | ast.ClassDef)]
    public = {name for name in imported if name and not name.startswith("_")}
    assert public | {part.name for part in own} == set(ae.__all__)
    checked = [(part, getattr(ae, part.name)) for part in own if isinstance(part, ast.FunctionDef)]
    for part in own:
        checked += [
            (each, getattr(getattr(ae, part.name), each.name))
            for each in getattr(part, "body", [])
            if isinstance(part, ast.ClassDef)
        ]
    assert len(checked) == 13
    for stated, function in checked:
        namespace = {}
        stated.returns, stated.decorator_list = None, []
        for argument in ast.walk(stated.args):
            if isinstance(argument, ast.arg):
                argument.annotation = None
        exec(ast.unparse(stated), namespace)
        found, expected = (inspect.signature(each).parameters for each in (namespace[stated.name], function))
        found = [each for each in found.values() if each.name not in ("cls", "self")]
        expected = [each for each in expected.values() if each.name not in ("cls", "self")]
        for one, other in zip(found, expected, strict=True):
            assert (one.name, one.kind) == (other.name, other.kind)
            assert (one.default is one.empty) == (other.default is other.empty), one
            assert one.default in (one.empty, ..., other.default)


def test_programs_of_guides_are_whole():
    text = "a\n```python\nx = 1\n```\n```python\nclass A:\n    ...\n```\n```python\ny = x\n```\n"
    one = mypy_ratchet.programs("docs/a.md", text, is_one=True)
    assert [*one] == ["docs_a_1.py"]
    assert one["docs_a_1.py"].endswith("x = 1\n\ny = x\n")
    assert len(mypy_ratchet.programs("docs/a.md", text, is_one=False)) == 2
