"""A figure changes only if its content does; one file says which commit and configuration made a study."""

import hashlib
import subprocess

import matplotlib.pyplot as plt
import pandas as pd
import pytest
from accelerated_evaluation.publishing import provenance
from accelerated_evaluation.publishing.figures.style import FORMATS
from accelerated_evaluation.publishing.provenance import PARTS, UNKNOWN, commit_of, origin_of, provenance_of
from accelerated_evaluation.publishing.published import figure, show, table
from accelerated_evaluation.publishing.study import Study
from matplotlib.figure import Figure
from PIL import Image

MINE = '{"study": "mine"}'


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
        (tmp_path / part).mkdir(parents=True)
        (tmp_path / part / "file").write_text("as it was\n")
    return tmp_path, commit


@figure
def fig01_line() -> tuple[Figure, pd.DataFrame]:
    drawn, axes = plt.subplots()
    axes.plot([0, 1])
    return drawn, pd.DataFrame({"x": [0, 1]})


@table("numbers")
def numbers() -> pd.DataFrame:
    return pd.DataFrame({"x": [0, 1]})


@pytest.fixture
def published(tmp_path, monkeypatch):
    """Return the function that publishes a figure and a table at a commit, with a configuration."""
    monkeypatch.setattr(Study, "source", "a source")

    def publish(commit: str, configuration: str) -> Study:
        study = Study(tmp_path / commit / "results" / "mine", tmp_path / commit / "figures" / "mine")
        monkeypatch.setattr(provenance, "commit_of", lambda project: commit)
        study.results.mkdir(parents=True)
        (study.results / "config.json").write_text(configuration)
        (study.results / "contents.json").write_text("[]")
        show(study, fig01_line)
        show(study, numbers)
        return study

    return publish


def files_of(study: Study) -> dict[str, bytes]:
    paths = [path for path in study.figures.rglob("*") if path.is_file()]
    return {path.relative_to(study.figures).as_posix(): path.read_bytes() for path in paths}


def test_published_files_are_the_same_at_two_commits_and_under_two_configurations(published):
    one, two = published("0123456789", MINE), published("fedcba9876", '{"study": "mine", "seed": 1}')
    assert origin_of(two) != origin_of(one)
    assert files_of(two) == files_of(one)
    assert {"fig01_line.csv", "tables/numbers.md", *(f"fig01_line.{end}" for end in FORMATS)} <= set(
        files_of(one)
    )


def test_each_format_names_the_figure_and_its_study(published):
    folder = published("0123456789", MINE).figures
    text = "Figure fig01_line of the study mine"
    assert Image.open(folder / "fig01_line.png").info["Description"].startswith(text)
    for extension in ("pdf", "svg"):
        assert text.encode() in (folder / f"fig01_line.{extension}").read_bytes()


def test_one_file_states_the_commit_the_configuration_and_every_published_file(published):
    study = published("0123456789", MINE)
    found = provenance_of(study, study.figures.rglob("*.*"))
    assert (found["study"], found["commit"]) == ("mine", "0123456789")
    assert found["configuration"] == hashlib.sha256(MINE.encode()).hexdigest()
    assert found["published"] == {
        name: hashlib.sha256(content).hexdigest() for name, content in files_of(study).items()
    }


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
