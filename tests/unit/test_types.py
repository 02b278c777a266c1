"""The type hints: the ratchet of mypy, and what an editor shows to callers."""

import re

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
