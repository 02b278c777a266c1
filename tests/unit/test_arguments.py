"""Arguments of public functions are checked and converted at the call, and errors say what is wrong."""

import math
from dataclasses import dataclass, replace

import numpy as np
import pytest
from accelerated_evaluation.base.arguments import (
    A_GENERATOR,
    a_number,
    by_name,
    checked,
    described,
    one_of,
)
from accelerated_evaluation.base.errors import InputError

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
        ((2.5,), {}, "seen 2.5; expected a whole number"),
        ((True,), {}, "seen True"),
        (("3",), {}, "seen '3'"),
        ((3, math.nan), {}, "argument share: seen nan; expected a number from 0 to 1"),
        ((3, 1.1), {}, "seen 1.1"),
        ((3,), {"capital": "de"}, "argument capital: seen 'de'; expected a capital, or its name: fr, it"),
        ((3,), {"capital": 3}, "seen 3"),
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
    with pytest.raises(TypeError, match="missing a required argument: 'size'"):
        drawn()


@pytest.mark.parametrize(
    ("value", "words"),
    [
        ("text", "'text'"),
        (None, "None"),
        (np.zeros((2, 3)), "a ndarray of shape (2, 3)"),
        (Part, "the class Part"),
        (len, "the function len"),
        (Part(1), "a Part"),
    ],
)
def test_a_wrong_value_is_described_in_a_few_words(value, words):
    assert described(value) == words
