"""Rules that the files of the project keep."""

import re
import tomllib
from itertools import chain
from pathlib import Path

import nbformat
import pytest
import yaml
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

ROOT = Path(__file__).resolve().parents[2]
NOTEBOOKS = sorted((ROOT / "notebooks").rglob("*.ipynb"))


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_notebooks_are_parameterised_and_committed_without_outputs(path):
    notebook = nbformat.read(path, as_version=4)
    nbformat.validate(notebook)
    code = [cell for cell in notebook.cells if cell.cell_type == "code"]
    assert notebook.cells[0].cell_type == "markdown"
    assert code[0].metadata.get("tags") == ["parameters"]
    for cell in code:
        assert not cell.outputs
        assert cell.execution_count is None
        assert not re.search(r"^\s*(def|class) ", cell.source, flags=re.MULTILINE)


def test_every_rule_has_been_measured_for_the_cluster(project):
    def listed(name):
        listing = project.run("--list", config=f"config/{name}.yaml").stdout
        return set(re.findall(r"^(\w+)(?: \(|$)", listing, re.MULTILINE)) - {"all", "figures", "tables"}

    rules = listed("config") | listed("left_turn")
    asked = yaml.safe_load((ROOT / "profiles/slurm/config.yaml").read_text())
    assert len(rules) > 40
    assert set(asked["set-resources"]) == rules, "run python benchmarks/rules.py results/STUDY"
    assert set(asked["groups"]) <= rules


@pytest.mark.parametrize(
    ("lock", "extras"),
    [
        ("environment.txt", ("study", "cluster", "provenance", "dev")),
        ("benchmarks/environment.txt", ("peers",)),
    ],
)
def test_locks_pin_what_the_project_asks_for(lock, extras):
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    asked = [project["dependencies"], *(project["optional-dependencies"][name] for name in extras)]
    pins: dict[str, list[str]] = {}
    for name, version in re.findall(r"^([\w.-]+)==([^ ;\\]+)", (ROOT / lock).read_text(), re.MULTILINE):
        pins.setdefault(canonicalize_name(name), []).append(version)
    for line in chain.from_iterable(asked):
        requirement = Requirement(line)
        versions = pins.get(canonicalize_name(requirement.name))
        assert versions, f"{requirement.name} is not in {lock}; run make lock"
        assert all(requirement.specifier.contains(version) for version in versions), requirement


@pytest.mark.parametrize("lock", ["environment.txt", "benchmarks/environment.txt"])
def test_every_pin_has_a_hash_and_none_names_a_host(lock):
    pins = (ROOT / lock).read_text()
    assert "://" not in pins
    for entry in re.split(r"\n(?=\S)", pins):
        if "==" in entry:
            assert "--hash=sha256:" in entry, entry


def test_rooms_import_only_rooms_to_their_left():
    library = ROOT / "workflow" / "accelerated_evaluation"
    rooms = [
        "base",
        "records",
        "distributions",
        "laws",
        "scenarios",
        "vehicles",
        "problem",
        "crash_map",
        "methods",
        "answer",
    ]
    rooms += ["track", "study", "publishing", "commands"]
    assert {path.stem for path in library.iterdir()} - {"__init__", "__pycache__", "cli"} == set(rooms)
    for index, room in enumerate(rooms):
        for path in [*(library / room).rglob("*.py"), *library.glob(f"{room}.py")]:
            imported = set(re.findall(r"^from accelerated_evaluation\.(\w+)", path.read_text(), re.MULTILINE))
            assert not imported & set(rooms[index + 1 :]), path
