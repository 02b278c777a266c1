"""The import graph, and the digests by which the files and settings of a user count."""

import hashlib
import json
from pathlib import Path

import pytest
from accelerated_evaluation.base.digests import content_digest, value_digest
from accelerated_evaluation.records.sources import SOURCES
from accelerated_evaluation.study.configuration import load
from accelerated_evaluation.study.dependencies import imported_modules, in_order, without_unused

MODULES = {
    "__init__.py": "",
    "alone.py": "import numpy\nfrom house_of_others import alone\n",
    "shared.py": "from house.alone import something\n",
    "lazy.py": "def f():\n    import house.room.deep as deep\n    return deep\n",
    "room/__init__.py": "",
    "room/deep.py": "from ..shared import x\n",
    "circle.py": "from house import circle_back\n",
    "circle_back.py": "from house.circle import x\n",
    "members/__init__.py": "from house.registry import Registry\nALL = Registry('x', __name__, __path__)\n",
    "members/one.py": "from house.shared import x\n@ALL.add('one')\nclass One: ...\n",
    "members/group/__init__.py": "from house.members.group import part\n@ALL.add('many')\nclass Many: ...\n",
    "members/group/part.py": "",
    "members/group/other.py": "",
    "members/helper.py": "@decorated(size=3)\ndef help(): ...\n",
    "registry.py": "class Registry: ...\n",
    "far.py": "from house.registry import Registry\nALL = Registry('x', 'house.guests', ['guests'])\n",
    "guests/guest.py": "from house import alone\nGUEST = ALL.add('guest')(print('made'))\n",
}
ONE = {"members/one.py", "shared.py", "alone.py"}  # what the first member needs


@pytest.fixture
def house(tmp_path) -> Path:
    """Return a package of toy modules."""
    for name, code in MODULES.items():
        path = tmp_path / "house" / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(code)
    return tmp_path / "house"


def imported(house: Path, code: str) -> set[str]:
    script = house.parent / "script.py"
    script.write_text(code)
    return {str(path.relative_to(house)) for path in imported_modules([script], house)} - {"__init__.py"}


@pytest.mark.parametrize(
    ("code", "modules"),
    [
        ("import json\nfrom scipy import stats\n", set()),
        ("from house.alone import f\n", {"alone.py"}),
        ("import house.shared\n", {"shared.py", "alone.py"}),
        ("from house import shared as s\n", {"shared.py", "alone.py"}),
        ("if True:\n    from house.lazy import f\n",
         {"lazy.py", "room/__init__.py", "room/deep.py", "shared.py", "alone.py"}),
        ("from house.circle import x\n", {"circle.py", "circle_back.py"}),
        ("from house.room import deep\n", {"room/__init__.py", "room/deep.py", "shared.py", "alone.py"}),
    ],
)  # fmt: skip
def test_modules_that_a_script_imports(house, code, modules):
    assert imported(house, code) == modules


def test_packages_in_the_same_folder_count_as_well(house):
    neighbour = house.parent / "neighbour"
    neighbour.mkdir()
    (neighbour / "__init__.py").write_text("")
    (neighbour / "part.py").write_text("from house.alone import f\n")
    script = house.parent / "script.py"
    script.write_text("from neighbour.part import g\n")
    found = imported_modules([script], house)
    assert {path.relative_to(house.parent).as_posix() for path in found} == {
        "house/__init__.py",
        "house/alone.py",
        "neighbour/__init__.py",
        "neighbour/part.py",
    }


@pytest.mark.parametrize(
    ("named", "members"),
    [
        (
            None,
            {"members/one.py", "shared.py", "alone.py", "members/group/__init__.py", "members/group/part.py"},
        ),
        (["one"], {"members/one.py", "shared.py", "alone.py"}),
        ([], set()),
    ],
)
def test_who_looks_up_a_registry_depends_on_the_members_that_it_may_get(house, named, members):
    script = house.parent / "script.py"
    script.write_text("from house.members import ALL\n")
    modules = imported_modules([script], house, {} if named is None else {"members": named})
    found = {str(path.relative_to(house)) for path in modules}
    assert found == members | {"__init__.py", "members/__init__.py", "registry.py"}


@pytest.mark.parametrize(("named", "members"), [("guest", {"guests/guest.py", "alone.py"}), ("none", set())])
def test_a_registry_may_name_another_package_and_a_member_may_be_an_object(house, named, members):
    script = house.parent / "script.py"
    script.write_text("from house.far import ALL\n")
    found = {str(path.relative_to(house)) for path in imported_modules([script], house, {"guests": [named]})}
    assert found == members | {"__init__.py", "far.py", "registry.py"}


def test_code_cells_of_a_notebook_count_and_its_text_does_not(house, tmp_path):
    cells = [
        {"cell_type": "markdown", "source": ["from house import circle\n"]},
        {"cell_type": "code", "source": ["import json\n", "from house import alone\n"]},
    ]
    notebook = tmp_path / "notebook.ipynb"
    notebook.write_text(json.dumps({"cells": cells}))
    assert house / "alone.py" in imported_modules([notebook], house)
    assert house / "circle.py" not in imported_modules([notebook], house)


def test_content_counts_and_dates_and_names_do_not(tmp_path):
    one, two = tmp_path / "one.csv", tmp_path / "two.csv"
    one.write_text("1\n")
    two.write_text("1\n")
    assert content_digest([one]) == content_digest([two])
    two.write_text("2\n")
    assert content_digest([one]) != content_digest([two])
    assert content_digest([one, two]) != content_digest([two, one])


def test_a_file_to_be_retrieved_counts_as_the_one_that_will_come(tmp_path):
    path = tmp_path / "records.mat"
    foreseen = content_digest([path], missing=hashlib.sha256(b"1\n").hexdigest())
    path.write_text("1\n")
    assert content_digest([path]) == foreseen


def test_the_order_of_keys_does_not_count():
    one, two = {"a": 1, "b": [{"c": 2, "d": 3}]}, {"b": [{"d": 3, "c": 2}], "a": 1}
    assert repr(in_order(one)) == repr(in_order(two))
    assert value_digest(one) == value_digest(two)
    assert value_digest(one) != value_digest(one | {"a": 2})


def test_sources_that_are_not_used_do_not_count():
    config = load()
    other = {**config["data"], "table": {**config["data"]["table"], "path": "mine.csv"}}
    assert without_unused(config, SOURCES) == without_unused({**config, "data": other}, SOURCES)
    assert set(without_unused(config, SOURCES)["data"]) & set(SOURCES) == {config["data"]["source"]}
