"""Arguments of public functions are checked and converted at the call, and errors say what is wrong."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from accelerated_evaluation.base.arguments import a_number, by_name, described, one_of
from accelerated_evaluation.base.checking import checked
from accelerated_evaluation.base.errors import InputError
from accelerated_evaluation.base.randomness import A_GENERATOR
from numpy.typing import NDArray

CAPITALS = {"fr": b"Paris", "it": b"Rome"}


@checked(
    size=a_number(1, whole=True),
    share=a_number(0, 1),
    capital=by_name(CAPITALS, bytes, "a capital"),
    generator=A_GENERATOR,
    names=one_of(list, tuple, words="a list of names"),
)
def drawn(size, share=0.5, *, capital=None, generator=None, names=()):
    """Return the arguments."""
    return size, share, capital, generator, names


@checked(share=a_number(0, 1))
@dataclass(frozen=True)
class Part:
    """A part of a whole."""

    share: float
    name: str = "part"


def test_values_that_fit_are_used_and_converted():
    assert drawn(3) == (3, 0.5, None, None, ())
    assert drawn(np.int64(3), 1, capital="it")[:3] == (3, 1.0, b"Rome")
    assert drawn(3, capital=b"Oslo")[2] == b"Oslo"
    generator = np.random.default_rng(1)
    assert drawn(3, generator=generator)[3] is generator
    first, second = (drawn(3, generator=7)[3].random() for _ in range(2))
    assert first == second != drawn(3, generator=8)[3].random()


@pytest.mark.parametrize(
    ("given", "named", "message"),
    [
        (
            (0,),
            {},
            "drawn, argument size: seen 0; expected a whole number of 1 or more. Correct the argument.",
        ),
        ((3, math.nan), {}, "argument share: seen nan; expected a number from 0 to 1"),
        ((3,), {"capital": "de"}, "argument capital: seen 'de'; expected a capital, or its name: fr, it"),
        ((3,), {"generator": -1}, "argument generator: seen -1; expected a numpy.random.Generator"),
        ((3,), {"generator": np.random}, "seen a module"),
        ((3,), {"names": "ab"}, "argument names: seen 'ab'; expected a list of names"),
    ],
)
def test_a_value_that_does_not_fit_is_named_with_what_is_expected(given, named, message):
    with pytest.raises(InputError) as error:
        drawn(*given, **named)
    assert message in str(error.value)


def test_a_class_checks_its_arguments_also_when_it_is_changed():
    part = Part(1)
    assert (part.share, part.name) == (1.0, "part")
    with pytest.raises(InputError, match="Part, argument share: seen 2; expected a number from 0 to 1"):
        Part(share=2)
    with pytest.raises(InputError, match="seen 'all'"):
        replace(part, share="all")


def test_the_name_and_the_text_of_a_function_remain():
    assert drawn.__name__ == "drawn"
    assert drawn.__doc__ == "Return the arguments."
    with pytest.raises(
        InputError, match=r"drawn: seen missing a required argument: .size.; expected drawn\(size"
    ):
        drawn()


@pytest.mark.parametrize(
    ("value", "words"),
    [
        ("text", "'text'"),
        (None, "None"),
        (np.zeros((2, 3)), "an array of shape (2, 3)"),
        (Part, "the class Part"),
        (len, "the function len"),
        (Part(1), "a Part"),
    ],
)
def test_a_wrong_value_is_described_in_a_few_words(value, words):
    assert described(value) == words


@checked()
def hinted(
    number: float = 0.0,
    count: int = 0,
    name: str | None = None,
    is_new: bool = False,
    values: NDArray[np.float64] = (),
    flags: NDArray[np.bool_] = (),
    names: Sequence[str] = (),
    path: Path | None = None,
    rule: Callable[[float], float] = abs,
    part: Part | None = None,
    anything: Any = None,
    *more: str,
    **others: Any,
):
    """Return the arguments."""
    return locals()


@pytest.mark.parametrize(
    ("name", "given", "used"),
    [
        ("number", 3, 3.0),
        ("count", np.int64(3), 3),
        ("name", "a", "a"),
        ("is_new", np.True_, True),
        ("values", [1, 2], [1.0, 2.0]),
        ("flags", [True, False], [True, False]),
        ("names", (name for name in "ab"), ("a", "b")),
        ("path", "a.csv", Path("a.csv")),
        ("rule", len, len),
        ("part", Part(1), Part(1)),
        ("anything", 3, 3),
    ],
)
def test_an_argument_is_checked_and_converted_by_its_type_hint(name, given, used):
    value = hinted(**{name: given})[name]
    assert np.array_equal(value, used)
    assert type(value) is (np.ndarray if name in ("values", "flags") else type(used))


@pytest.mark.parametrize(
    ("name", "given", "expected"),
    [
        ("number", "3", "a number"),
        ("number", True, "a number"),
        ("number", math.nan, "a number"),
        ("count", 2.5, "a whole number"),
        ("count", "1", "a whole number"),
        ("name", 3, "text or None"),
        ("is_new", 1, "True or False"),
        ("values", "12", "an array of numbers"),
        ("values", ["a"], "an array of numbers"),
        ("values", 3, "an array of numbers"),
        ("flags", [0, 1], "an array of true and false"),
        ("names", "ab", "a list, each of it text"),
        ("names", ["a", 1], "a list, each of it text"),
        ("names", {"a": 1}, "a list, each of it text"),
        *(("path", path, "a path .* or None") for path in (3, b"a", "a\0b", "a\ud800", "a" * 300)),
        ("rule", abs(-1), "a function"),
        ("rule", Part, "a function"),
        ("part", "all", "an object of the class Part or None"),
    ],
)
def test_an_argument_that_does_not_fit_its_type_hint_is_refused(name, given, expected):
    with pytest.raises(InputError, match=rf"hinted, argument {name}: seen .*; expected {expected}\. "):
        hinted(**{name: given})


def test_a_wrong_name_of_an_argument_is_refused():
    with pytest.raises(InputError, match=r"Part: seen .*'nme'; expected Part\(share, name\)\. Correct"):
        Part(1, nme="a")
