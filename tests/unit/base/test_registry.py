"""Registries: members are found by themselves, names are unique, and a mistyped name is told what is near."""

import sys
from collections.abc import Mapping

import pytest
from accelerated_evaluation import InputError
from accelerated_evaluation.base.registry import Registry

INIT = """
from accelerated_evaluation.base.registry import Registry
ANIMALS = Registry("animal", __name__, __path__)
"""
MEMBER = """
from zoo_of_the_test import ANIMALS

@ANIMALS.add("{name}")
class Animal:
    loud = {loud}
"""


@pytest.fixture
def zoo(tmp_path, monkeypatch):
    """A package of two members, each in a module that nothing else names."""
    folder = tmp_path / "zoo_of_the_test"
    folder.mkdir()
    (folder / "__init__.py").write_text(INIT)
    (folder / "far.py").write_text(MEMBER.format(name="zebra", loud=False))
    (folder / "near.py").write_text(MEMBER.format(name="ape", loud=True))
    monkeypatch.syspath_prepend(tmp_path)
    yield folder
    for name in [name for name in sys.modules if name.startswith("zoo_of_the_test")]:
        del sys.modules[name]


def animals():
    from zoo_of_the_test import ANIMALS

    return ANIMALS


@pytest.mark.parametrize(
    "asked",
    [
        lambda registry: registry["zebra"].loud is False,
        lambda registry: "zebra" in registry and "lion" not in registry,
        lambda registry: [*registry] == ["ape", "zebra"],
        lambda registry: len(registry) == 2,
        lambda registry: [name for name, member in registry.items() if member.loud] == ["ape"],
    ],
)
def test_members_are_found_at_the_first_question_whatever_it_is(zoo, asked):
    registry = animals()
    assert "zoo_of_the_test.far" not in sys.modules
    assert isinstance(registry, Mapping)
    assert asked(registry)
    assert "zoo_of_the_test.far" in sys.modules


def test_a_new_member_is_one_new_file(zoo):
    (zoo / "new.py").write_text(MEMBER.format(name="lion", loud=True))
    assert [*animals()] == ["ape", "lion", "zebra"]


def test_a_member_may_look_up_another_while_it_is_imported(zoo):
    (zoo / "a_first.py").write_text(
        "from zoo_of_the_test import ANIMALS\nimport zoo_of_the_test.near\nANIMALS['ape']\n"
    )
    assert [*animals()] == ["ape", "zebra"]


def test_two_members_of_one_name_are_refused(zoo):
    (zoo / "twin.py").write_text(MEMBER.format(name="zebra", loud=True))
    with pytest.raises(InputError, match="animal 'zebra': seen two members"):
        len(animals())


def test_the_same_member_may_register_twice():
    registry = Registry("thing", "none", [])
    member = object()
    assert registry.add("one")(member) is member
    registry.add("one")(member)
    registry.add("other")(member)
    assert dict(registry) == {"one": member, "other": member}
    with pytest.raises(InputError, match="thing 'one': seen two members"):
        registry.add("one")(object())
    assert registry["one"] is member


@pytest.mark.parametrize(
    ("name", "advice"),
    [("zebar", "Did you mean zebra?"), ("quokka", "Name one of these."), (3, "Name one of these.")],
)
def test_an_unknown_name_is_told_the_known_ones(zoo, name, advice):
    with pytest.raises(InputError) as error:
        animals()[name]
    assert str(error.value) == f"animal: seen {name!r}; expected one of ape, zebra. {advice}"


def test_an_empty_registry_has_no_member(tmp_path):
    registry = Registry("thing", "none", [str(tmp_path)])
    assert (len(registry), [*registry], "one" in registry) == (0, [], False)
    with pytest.raises(InputError, match="seen 'one'"):
        registry["one"]
