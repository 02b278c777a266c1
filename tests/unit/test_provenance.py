"""A figure alone tells what made it, and says so in the same bytes as long as that does not change."""

import hashlib
import re
import subprocess
from pathlib import Path
from types import SimpleNamespace

import matplotlib.pyplot as plt
import pandas as pd
import pytest
from accelerated_evaluation.publishing.archive.provenance import (
    PARTS,
    UNKNOWN,
    commit_of,
    described,
    origin_of,
)
from accelerated_evaluation.publishing.figures.style import FORMATS, save_figure
from PIL import Image

ORIGIN = {"study": "mine", "commit": "0123456789" * 4, "configuration": "ab" * 32}


@pytest.fixture
def repository(tmp_path):
    """Return a project of one commit, and the function that commits all of its files."""

    def git(*arguments: str) -> str:
        who = ["-c", "user.name=A", "-c", "user.email=a@example.org"]
        command = ["git", "-C", str(tmp_path), *who, *arguments]
        return subprocess.run(command, check=True, capture_output=True, text=True).stdout.strip()

    def commit() -> str:
        git("add", "--all")
        git("commit", "--quiet", "--message", "a commit")
        commit_of.cache_clear()
        return git("rev-parse", "HEAD")

    git("init", "--quiet")
    for part in PARTS:
        (tmp_path / part).mkdir()
        (tmp_path / part / "file").write_text("as it was\n")
    return tmp_path, commit


def saved(folder: Path, origin: dict[str, str]) -> dict[str, Path]:
    drawn, axes = plt.subplots()
    axes.plot([0, 1])
    save_figure(drawn, pd.DataFrame({"x": [0, 1]}), folder, "fig01", described("fig01", origin))
    return {extension: folder / f"fig01.{extension}" for extension in FORMATS}


def test_each_format_names_study_commit_and_configuration(tmp_path):
    paths = saved(tmp_path, ORIGIN)
    png = Image.open(paths["png"]).info
    assert {key: png[key.capitalize()] for key in ORIGIN} == ORIGIN
    pdf = paths["pdf"].read_bytes()
    svg = paths["svg"].read_text()
    for key, value in ORIGIN.items():
        assert value in png["Description"]
        assert f"{key}: {value}".encode() in pdf
        assert f"<rdf:li>{key}: {value}</rdf:li>" in re.sub(r"\s+(?=<)|(?<=>)\s+", "", svg)


def test_the_same_origin_gives_the_same_bytes(tmp_path):
    one, two = saved(tmp_path / "one", ORIGIN), saved(tmp_path / "two", ORIGIN)
    other = saved(tmp_path / "other", ORIGIN | {"commit": "fedcba9876" * 4})
    for extension in FORMATS:
        assert one[extension].read_bytes() == two[extension].read_bytes()
        assert one[extension].read_bytes() != other[extension].read_bytes()


def test_the_commit_is_the_last_one_that_changed_what_results_depend_on(repository):
    project, commit = repository
    first = commit()
    assert commit_of(project) == first
    (project / "figures").mkdir()
    (project / "figures" / "fig01.png").write_text(f"made at {first}")
    (project / "README.md").write_text("a text\n")
    assert commit() != first
    assert commit_of(project) == first
    (project / "workflow" / "file").write_text("changed\n")
    assert commit_of.__wrapped__(project) == f"{first} with changes"
    second = commit()
    assert commit_of(project) == second


def test_without_a_repository_the_commit_is_unknown(tmp_path, monkeypatch):
    monkeypatch.setenv("GIT_CEILING_DIRECTORIES", str(tmp_path.parent))
    assert commit_of.__wrapped__(tmp_path) == UNKNOWN
    monkeypatch.setenv("PATH", "")
    assert commit_of.__wrapped__(tmp_path) == UNKNOWN


def test_the_configuration_is_named_by_the_checksum_of_its_file(tmp_path):
    path = tmp_path / "config.json"
    path.write_text("{}\n")
    origin = origin_of(SimpleNamespace(name="mine", path=lambda name: tmp_path / name))
    assert origin["configuration"] == hashlib.sha256(path.read_bytes()).hexdigest()
    assert origin["study"] == "mine"
