"""What the Snakemake workflow catalogue and the Journal of Open Source Software ask of the files."""

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest
import yaml
from accelerated_evaluation.base.environment import missing_in_words, missing_packages

ROOT = Path(__file__).resolve().parents[2]


def test_the_linter_finds_nothing():
    lint = [sys.executable, "-m", "snakemake", "--lint", "--configfile", "config/config.yaml"]
    said = subprocess.run(lint, cwd=ROOT, capture_output=True, text=True)
    assert said.returncode == 0
    assert "your workflow is in a good condition" in said.stdout + said.stderr


# An environment with Snakemake alone: the packages of the study cannot be imported and are not installed.
BARE = """
import importlib.abc, importlib.metadata, importlib.util, pkgutil, sys

HIDDEN = {hidden!r}
version, found, modules = importlib.metadata.version, importlib.util.find_spec, pkgutil.iter_modules


class Hiding(importlib.abc.MetaPathFinder):
    def find_spec(self, name, path, target=None):
        if name.partition(".")[0] in HIDDEN:
            raise ModuleNotFoundError(f"No module named {{name!r}}", name=name)


def seen(name):
    if name.replace("-", "_") in HIDDEN:
        raise importlib.metadata.PackageNotFoundError(name)
    return version(name)


sys.meta_path.insert(0, Hiding())
importlib.metadata.version = seen
importlib.util.find_spec = lambda name, *rest: None if name in HIDDEN else found(name, *rest)
pkgutil.iter_modules = lambda *where: (
    each for each in modules(*where) if each.name not in HIDDEN and "plugin_slurm" not in each.name
)
"""
CONSOLE = "snakemake_logger_plugin_study"
STUDY = {"numpy", "scipy", "pandas", "numba", "papermill", "typst"}


def bare(tmp_path, hidden, *arguments):
    """Run Snakemake with the profile of the project where some packages are not installed."""
    (tmp_path / "sitecustomize.py").write_text(BARE.format(hidden=hidden))
    return subprocess.run(
        [sys.executable, "-m", "snakemake", "--cores", "2", *arguments],
        cwd=ROOT,
        env=os.environ | {"PYTHONPATH": str(tmp_path)},
        capture_output=True,
        text=True,
    )


@pytest.mark.parametrize("arguments", [["-n"], ["--lint"]])
def test_snakemake_alone_ends_in_one_sentence_with_two_ways_to_install(tmp_path, arguments):
    ended = bare(tmp_path, {CONSOLE, *STUDY}, *arguments)
    assert ended.returncode == 1
    printed = ended.stdout + ended.stderr  # a dry run prints on the first, all others on the second
    said = [line for line in printed.splitlines() if "not installed" in line]
    assert len(said) == 1
    for part in (
        *(STUDY - {"snakemake_logger_plugin_study"}),
        "`make environment`",
        "pip install --editable",
    ):
        assert part in said[0]
    assert "invalid choice" not in printed
    assert "No module named" not in printed


def test_the_study_is_planned_without_its_console(tmp_path):
    """The profile names the console only where it is installed."""
    ended = bare(tmp_path, {CONSOLE}, "-n", "--forceall")
    assert ended.returncode == 0, ended.stderr[-2000:]
    assert "Job stats" in ended.stdout + ended.stderr


def test_a_container_that_was_not_built_is_named(tmp_path):
    ended = bare(tmp_path, set(), "-n", "--software-deployment-method", "apptainer")
    assert ended.returncode == 1
    assert "environment.sif: seen no such file; expected the image" in ended.stdout + ended.stderr
    assert "`make container`" in ended.stdout + ended.stderr


def test_the_packages_that_are_missing_are_those_of_the_project(tmp_path):
    (tmp_path / "pyproject.toml").write_text(
        '[project]\ndependencies = ["own>=1", "numpy>=2", "none-such>=3"]\n'
        '[project.optional-dependencies]\nstudy = ["nothing.here"]\n'
    )
    (tmp_path / "own" / "src").mkdir(parents=True)
    assert missing_packages(tmp_path) == ["none-such", "nothing.here"]
    assert "(none-such, nothing.here)" in missing_in_words(tmp_path)
    assert missing_packages(tmp_path / "own") == []
    assert missing_in_words() == ""


def test_the_graph_of_the_documentation_is_that_of_the_rules(tmp_path):
    printed = bare(tmp_path, set(), "--rulegraph", "mermaid-js", "--forceall").stdout
    names = dict(re.findall(r"(id\d+)\[(\w+)\]", printed))
    wanted = {(names[a], names[b]) for a, b in re.findall(r"(id\d+) --> (id\d+)", printed)}
    text = (ROOT / "workflow" / "documentation.md").read_text()
    assert set(re.findall(r"^    (\w+) --> (\w+)$", text, re.MULTILINE)) == wanted
    assert len(wanted) > 100


def test_the_catalogue_finds_the_workflow():
    settings = yaml.safe_load((ROOT / ".snakemake-workflow-catalog.yml").read_text())
    deployment = settings["usage"]["software-stack-deployment"]
    assert set(deployment) == {"conda", "apptainer", "apptainer+conda", "report"}
    assert deployment["report"] is True
    # No image is published and no rule has a conda environment, so neither option installs anything.
    assert not any(value for name, value in deployment.items() if name != "report")
    assert (ROOT / "workflow/documentation.md").is_file()
    readme = (ROOT / "README.md").read_text().lower()
    assert "snakemake" in readme
    assert "workflow" in readme
    assert (ROOT / "workflow/Snakefile").is_file()
    assert (ROOT / "config/README.md").is_file()
    assert list((ROOT / "workflow/rules").glob("*.smk"))


def test_the_conda_environment_installs_the_lock():
    environment = yaml.safe_load((ROOT / "environment.yaml").read_text())
    assert environment["channels"] == ["conda-forge", "nodefaults"]
    *programs, pip = environment["dependencies"]
    assert "pip" in programs
    assert pip["pip"] == ["--requirement environment.txt"]


def test_the_container_copies_what_exists():
    recipe = (ROOT / "Dockerfile").read_text()
    for sources in re.findall(r"^COPY (.*) \S+$", recipe, re.MULTILINE):
        assert all((ROOT / source).exists() for source in sources.split())
