"""Rules that the files of the project keep."""

import re
import tomllib
from itertools import chain
from pathlib import Path

import nbformat
import pytest
import yaml
from accelerated_evaluation.answer.ways.words import study_in_short
from accelerated_evaluation.study.dependencies import LIBRARY, ROOMS, SAMPLER, files_of
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
    placeholders = [
        cell for cell in notebook.cells if cell.cell_type == "markdown" and re.search(r"{{|{%", cell.source)
    ]
    assert not placeholders, "a reader in Jupyter would see them: begin a cell of code with %%text"
    assert code[0].metadata.get("tags") == ["parameters"]
    for cell in code:
        assert not cell.outputs
        assert cell.execution_count is None
        hidden = cell.metadata.get("jupyter", {}).get("source_hidden", False)
        assert hidden == cell.source.startswith(("%%text", "import ", "from "))
        assert not re.search(r"^\s*(def|class) ", cell.source, flags=re.MULTILINE)


def test_three_parts_have_twelve_chapters_of_at_most_a_thousand_words():
    parts = {}
    for path in (ROOT / "notebooks").glob("[01]*.ipynb"):
        notebook = nbformat.read(path, as_version=4)
        texts = [
            cell.source
            for cell in notebook.cells
            if cell.cell_type == "markdown" or cell.source.startswith("%%text")
        ]
        words = re.sub(r"\{[{%].*?[%}]\}", " 1 ", "\n".join(texts), flags=re.DOTALL).split()
        assert len(words) <= 1000, path.name
        boxed = any("> **As in the paper:**" in text for text in texts)
        parts.setdefault(notebook.metadata["part"], []).append((path.stem[:2], boxed))
    numbers = {part: sorted(chapters) for part, chapters in parts.items()}
    assert numbers == {
        "Part A: the answer": [("01", False), ("02", False), ("03", False), ("04", False)],
        "Part B: the paper": [("05", True), ("06", True), ("07", True), ("08", True)],
        "Part C: methods": [("09", False), ("10", False), ("11", False), ("12", False)],
    }


def test_the_workflow_parses_with_a_storage(project, tmp_path):
    pytest.importorskip("snakemake_storage_plugin_fs", reason="the storage plugin fs is not installed")
    storage = ("--default-storage-provider", "fs", "--default-storage-prefix", str(tmp_path))
    done = project.run("--dry-run", "--quiet", *storage)
    assert done.returncode == 0, done.stderr
    assert study_in_short(tmp_path, "cut-in") == ["The results are in the storage of Snakemake."]


def test_every_rule_has_been_measured_for_the_cluster(project):
    listing = project.run("--list", config="config/config.yaml").stdout
    rules = set(re.findall(r"^(\w+)(?: \(|$)", listing, re.MULTILINE)) - {"all", "figures", "tables"}
    rules |= set(  # those of other scenarios alone
        re.findall(r"^rule (\w+):", (ROOT / "workflow/rules/scenario.smk").read_text(), re.MULTILINE)
    )
    asked = yaml.safe_load((ROOT / "profiles/slurm/config.yaml").read_text())
    assert len(rules) > 40
    assert set(asked["set-resources"]) == rules, "run python benchmarks/rules.py results/STUDY"
    assert set(asked["groups"]) <= rules


@pytest.mark.parametrize(
    ("lock", "extras"),
    [
        ("environment.txt", ("study",)),
        (
            "tests/environment.txt",
            ("recordings", "fmu", "cluster", "provenance", "scenarios", "simulators", "dev"),
        ),
        ("benchmarks/environment.txt", ("peers",)),
    ],
)
def test_locks_pin_what_the_project_asks_for(lock, extras):
    project, sampler = (
        tomllib.loads((ROOT / folder / "pyproject.toml").read_text())["project"]
        for folder in (".", "fewruns")
    )
    asked = [project["dependencies"], *(project["optional-dependencies"][name] for name in extras)]
    asked.append(sampler["dependencies"])
    pins: dict[str, list[str]] = {}
    for name, version in re.findall(r"^([\w.-]+)==([^ ;\\]+)", (ROOT / lock).read_text(), re.MULTILINE):
        pins.setdefault(canonicalize_name(name), []).append(version)
    for line in chain.from_iterable(asked):
        requirement = Requirement(line)
        if requirement.name == sampler["name"]:  # installed from its folder
            assert requirement.specifier.contains(sampler["version"])
            continue
        versions = pins.get(canonicalize_name(requirement.name))
        assert versions, f"{requirement.name} is not in {lock}; run make lock"
        assert all(requirement.specifier.contains(version) for version in versions), requirement


@pytest.mark.parametrize("lock", ["environment.txt", "tests/environment.txt", "benchmarks/environment.txt"])
def test_every_pin_has_a_hash_and_none_names_a_host(lock):
    pins = (ROOT / lock).read_text()
    assert "://" not in pins
    for entry in re.split(r"\n(?=\S)", pins):
        if "==" in entry:
            assert "--hash=sha256:" in entry, entry


IMPORTED = re.compile(r"^ *(?:from|import) (?:accelerated_evaluation\.)?(\w+)", re.MULTILINE)


def rooms_in(code: str) -> set[str]:
    """Return the rooms, and the package of the sampler, that code imports."""
    return set(IMPORTED.findall(code)) & set(ROOMS)


def test_rooms_import_only_rooms_to_their_left():
    found = {path.stem for path in LIBRARY.iterdir()} - {"__init__", "__pycache__", "cli", "py"}
    assert found | {SAMPLER} == set(ROOMS)
    for index, room in enumerate(ROOMS):
        for path in files_of(room):
            assert rooms_in(path.read_text()) <= set(ROOMS[: index + 1]), path


def test_rooms_of_the_answer_import_only_earlier_ones():
    order = ["candidates", "ways", "consequences"]
    for index, room in enumerate(order):
        for path in files_of(f"answer/{room}"):
            imported = re.findall(r"accelerated_evaluation\.answer\.(\w+)", path.read_text())
            assert set(imported) <= set(order[: index + 1]), path


# Functions that make settings or named records of a configuration, at the top of commands, scripts and rules.
MAKERS = {
    "answer/settings.py": {"of", "law_settings", "limits_of", "support_of"},
    "records/named.py": {"of"},
    "scenarios/record_table.py": {"of", "named_records_of"},
}


def test_functions_take_values_and_only_settings_are_made_from_the_configuration():
    for room in set(ROOMS) - {"study", "commands"}:
        for path in files_of(room):
            code = path.read_text()
            made = set(re.findall(r"def (\w+)\([^)]*\bconfig\b", code))
            own = {"of"} if path.name == "settings.py" else set()
            assert made <= MAKERS.get("/".join(path.parts[-2:]), own), path
            assert "child_generator(config" not in code, path


def test_every_rule_depends_on_the_last_room_from_which_its_script_imports():
    rules = "\n".join(path.read_text() for path in (ROOT / "workflow/rules").glob("*.smk"))
    declared = re.findall(
        r'library=(?:lambda wildcards: )?code_up_to\(\s*"(\w+)"[^)]*\).*?scripts/(\w+\.py)', rules, re.DOTALL
    )
    assert {script for _, script in declared} == {path.name for path in (ROOT / "workflow/scripts").iterdir()}
    assert len(declared) == rules.count("    script:")
    for room, script in declared:
        code = (ROOT / "workflow/scripts" / script).read_text()
        imported = rooms_in(code.replace("accelerated_evaluation.study.jobs", ""))
        assert max(imported, key=ROOMS.index, default="base") == room, script
