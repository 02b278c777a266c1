"""What the Snakemake workflow catalogue and the Journal of Open Source Software ask of the files."""

import re
import subprocess
import sys
from pathlib import Path

import yaml

ROOT = Path(__file__).resolve().parents[2]


def test_the_linter_finds_one_thing_only():
    lint = [sys.executable, "-m", "snakemake", "--lint", "--configfile", "config/config.yaml"]
    said = subprocess.run(lint, cwd=ROOT, capture_output=True, text=True)
    found = set(re.findall(r"^    \* (.*)$", said.stdout + said.stderr, re.MULTILINE))
    assert found == {"Specify a conda environment or container for each rule.:"}


def test_the_catalogue_finds_the_workflow():
    settings = yaml.safe_load((ROOT / ".snakemake-workflow-catalog.yml").read_text())
    deployment = settings["usage"]["software-stack-deployment"]
    assert set(deployment) == {"conda", "apptainer", "apptainer+conda", "report"}
    assert deployment["report"] is True
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
