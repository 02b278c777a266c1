"""The whole study in miniature: complete, repeatable, resumable."""

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pandas as pd
import pytest
from accelerated_evaluation.laws.files import signed
from accelerated_evaluation.publishing.book.catalogue import read_contents
from accelerated_evaluation.publishing.provenance import UNKNOWN

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "unit"))

from claim_places import contradicted

DATA = "Safety Pilot Model Deployment (real events), a sample of 6,000"
TABLES = (
    "encounters_account",
    "candidates",
    "table1_sample_size",
    "table2_computation",
    "estimates",
    "claims",
)
# One result of nearly every rule.
RESUMED = (
    "results/smoke/notebooks/05_data_and_single_models.ipynb",
    "results/smoke/candidates.csv",
    "results/smoke/coverage/single.csv",
    "results/smoke/crude.csv",
    "results/smoke/estimates/all_heuristic.csv",
    "results/smoke/estimates/all_surrogate.csv",
    "results/smoke/sensitivity.csv",
    "results/smoke/uncertainty.csv",
)

ANSWER = """
import sys
from accelerated_evaluation import choose_draws
from accelerated_evaluation import read_records
from accelerated_evaluation.laws.files import write_law
from accelerated_evaluation.study.configuration import load, resolved
config = resolved(load(sys.argv[2:]))
records = read_records(config)
write_law(sys.argv[1], choose_draws("answer", records, config).law, records.table)
"""


@pytest.mark.studies
def test_a_killed_run_resumes_on_one_core_and_ends_with_the_same_bytes(project_with_toys, request):
    """The whole study, which it is compared with, is asked for last, as another process may be running it."""
    project = project_with_toys
    process = subprocess.Popen(
        project.command(*RESUMED, cores=1),
        cwd=project.folder,
        env=project.environment,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        start_new_session=True,
    )
    deadline = time.monotonic() + 300
    while not list(project.folder.glob("results/smoke/cross_entropy/*.json")):
        assert process.poll() is None, "the run ended before it could be killed"
        assert time.monotonic() < deadline
        time.sleep(0.1)
    os.killpg(process.pid, signal.SIGKILL)
    process.wait()
    assert not (project.folder / "results/smoke/estimates.csv").exists()
    run = project.run(*RESUMED, cores=1)  # the lock of the killed run is known to be dead
    assert run.returncode == 0, run.stderr[-5000:]
    tables, expected = project.tables(), request.getfixturevalue("finished").tables()
    assert {"figures/smoke/fig02_data.csv", *RESUMED[1:]} <= set(tables)
    assert {path: content for path, content in expected.items() if path in tables} == tables


def test_every_figure_and_table_of_the_paper_is_made(finished):
    figures = finished.folder / "figures" / "smoke"
    for number in range(1, 14):
        for extension in ("pdf", "svg", "png", "csv"):
            paths = list(figures.glob(f"fig{number:02d}_*.{extension}"))
            assert len(paths) == 1, (number, extension)
            assert paths[0].stat().st_size > 0
    for name in (
        "table1_sample_size",
        "table2_computation",
        "candidates",
        "encounters_account",
        "estimates",
        "claims",
    ):
        for extension in ("csv", "md", "tex"):
            assert (figures / "tables" / f"{name}.{extension}").stat().st_size > 0
    for notebook in (finished.folder / "notebooks").glob("*.ipynb"):
        html = (finished.folder / "results" / "smoke" / "book" / f"{notebook.stem}.html").read_text()
        assert DATA in html
    assert (finished.folder / "results/smoke/logs/book.log").read_text() == ""  # Sphinx warns of nothing


def test_every_notebook_declares_exactly_what_it_read_and_made(finished):
    executed = sorted((finished.folder / "results/smoke/notebooks").glob("*.ipynb"))
    assert len(executed) > 10
    made = set(json.loads((finished.folder / "results/smoke/contents.json").read_text()))
    for path in executed:
        template = finished.folder / "notebooks" / path.name
        declared = read_contents(template, lambda name: name in made or "{" in name)
        assert [*map(sorted, read_contents(path))] == [*map(sorted, declared)], path.name


def test_published_tables_say_what_the_data_are(finished):
    for path in (finished.folder / "figures" / "smoke" / "tables").glob("*.csv"):
        rows = path.read_text().splitlines()[1:]
        assert DATA in "".join(rows) or not rows, path


def test_the_number_of_every_claim_stands_where_the_table_says(finished):
    assert contradicted(finished.folder / "figures" / "smoke" / "tables") == []


def test_the_estimate_alone_is_under_the_draws_of_the_answer(finished, tmp_path):
    """In a process of its own, which imports the library of the finished study, with its toys."""
    law = tmp_path / "law.json"
    done = subprocess.run(
        [sys.executable, "-c", ANSWER, str(law), *finished.configs],
        cwd=finished.folder,
        env=finished.environment,
        capture_output=True,
        text=True,
    )
    assert done.returncode == 0, done.stderr
    known = json.loads((finished.folder / "results/smoke/laws/draws.json").read_text())
    assert known.pop("verdict") is not None
    assert json.loads(law.read_text()) == signed(known)


def test_a_second_run_does_nothing(finished):
    run = finished.run()
    assert run.returncode == 0, run.stderr
    assert "Nothing to be done" in run.stdout + run.stderr


@pytest.mark.studies
def test_published_files_stay_the_same_at_another_commit(finished, tmp_path):
    """The finished study ran outside of a repository; in the copy, a chapter is published at a commit."""
    project = finished.copied(tmp_path)
    git("init", "--quiet", folder=project.folder)
    git("add", "figures", "workflow", folder=project.folder)
    git("commit", "--quiet", "--message", "another", folder=project.folder)
    run = project.run("book", "--forcerun", "run_91_the_records")
    assert run.returncode == 0, run.stderr[-3000:]
    assert "Running the notebook 91_the_records" in run.stderr
    assert git("status", "--porcelain", "--", "figures", folder=project.folder) == ""
    first, second = (
        json.loads((folder / "results/smoke/provenance.json").read_text())
        for folder in (finished.folder, project.folder)
    )
    assert first["commit"] == UNKNOWN
    assert second["commit"].startswith(git("rev-parse", "HEAD", folder=project.folder))
    assert second["published"] == first["published"]
    assert len(first["published"]) == len(list(project.folder.glob("figures/smoke/**/*.*")))


def git(*arguments: str, folder: Path) -> str:
    """Return the output of a git command in a folder."""
    who = ["-c", "user.name=A", "-c", "user.email=a@example.org"]
    command = ["git", "-C", str(folder), *who, *arguments]
    return subprocess.run(command, check=True, capture_output=True, text=True).stdout.strip()


def test_the_report_holds_figures_and_tables(finished):
    run = finished.run("--report", "report.html")
    assert run.returncode == 0, run.stderr[-3000:]
    html = (finished.folder / "report.html").read_text()
    for name in ("fig01_concept", "fig13_relative_half_width", "claims"):
        assert name in html


def test_a_miniature_with_a_vehicle_of_its_own_gets_an_article(finished):
    run = finished.run("article")
    assert run.returncode == 0, run.stderr[-3000:]
    results = finished.folder / "results" / "smoke"
    assert (results / "article.pdf").read_bytes().startswith(b"%PDF-")
    here, published = (
        pd.read_csv(figures / "numbers.csv").set_index("name")
        for figures in (
            finished.folder / "figures" / "smoke",
            Path(__file__).resolve().parents[2] / "figures" / "spmd",
        )
    )
    assert here.index.equals(published.index)
    assert 0 < here.loc["records_kept", "value"] < published.loc["records_kept", "value"]
