"""From a figure to its code: the line below each figure of the book, and the table in REPRODUCE.md."""

import inspect
import re
import subprocess
from pathlib import Path

import pytest
from accelerated_evaluation.publishing import provenance
from accelerated_evaluation.publishing.book.catalogue import read_contents
from accelerated_evaluation.publishing.book.site import Parts
from accelerated_evaluation.publishing.figures.estimates import fig12_crash_probability
from accelerated_evaluation.publishing.provenance import page_of_code
from accelerated_evaluation.publishing.published import FIGURES
from accelerated_evaluation.publishing.study import Study

ROOT = Path(__file__).resolve().parents[3]
CAPTIONS = ROOT / "workflow" / "report"
NOTEBOOKS = sorted((ROOT / "notebooks").glob("*.ipynb"))
HEAD = "| paper | here | chapter | rule | only this one |\n| --- | --- | --- | --- | --- |"
TABLES = {"table1_sample_size": "table I", "table2_computation": "table II"}  # of the paper


def table_of_commands():
    """Return the table of REPRODUCE.md: figures and the tables of the paper, by name."""
    lines = []
    for notebook in NOTEBOOKS:
        # The published study is one of cut-ins.
        contents = read_contents(notebook, lambda name: not name.startswith("scenario/"))
        tables = [name for name in contents.tables if name in TABLES]
        files = [f"{name}.png" for name in contents.figures] + [f"tables/{name}.csv" for name in tables]
        for name, file in zip([*contents.figures, *tables], files, strict=True):
            caption = (CAPTIONS / f"{name}.rst").read_text(encoding="utf-8")
            answered = re.search(r"Corresponds to (figure \d+) of the paper", caption)
            paper = answered[1] if answered else TABLES.get(name, "–")
            command = f"`snakemake --cores 2 figures/spmd/{file}`"
            lines.append(f"| {paper} | `{name}` | {notebook.stem[:2]} | `run_{notebook.stem}` | {command} |")
    return "\n".join([HEAD, *sorted(lines, key=lambda line: line.split("|")[2])])


def test_the_table_of_commands_in_reproduce_is_complete():
    table = table_of_commands()
    assert table in (ROOT / "REPRODUCE.md").read_text(encoding="utf-8"), f"Replace the table by\n{table}"


def test_a_figure_names_its_function_its_results_and_its_rule(tmp_path):
    (tmp_path / "contents.json").write_text('["estimates_course.csv", "exact.csv", "laws/answer.csv"]')
    parts = Parts(Study(tmp_path, "figures/spmd"), NOTEBOOKS, {}, [], ROOT)
    line = inspect.getsourcelines(fig12_crash_probability)[1]
    origin = parts.origin("fig12_crash_probability")
    assert f"publishing/figures/estimates.py, line {line})" in origin
    assert "`estimates_course.csv`, `exact.csv`" in origin
    assert "`run_08_results`" in origin
    assert "`snakemake --cores 2 figures/spmd/fig12_crash_probability.png`" in origin
    assert "results: `laws/answer.csv`;" in parts.origin("fig23_answer")  # others are not made
    shown = {name for path in NOTEBOOKS for name in read_contents(path).figures}
    assert shown <= FIGURES.keys()


@pytest.fixture
def answers(monkeypatch):
    """What git answers to each command; an exception is raised."""
    texts = {"log": "ab" * 20, "status": "", "remote": "git@example.org:me/cut-ins.git"}

    def git(project, command, *rest):
        if isinstance(texts[command], Exception):
            raise texts[command]
        return texts[command]

    monkeypatch.setattr(provenance, "_git", git)
    provenance.commit_of.cache_clear()
    yield texts
    provenance.commit_of.cache_clear()


@pytest.mark.parametrize(
    "origin",
    [
        "git@example.org:me/cut-ins.git",
        "https://user:word@example.org/me/cut-ins",
        "ssh://git@example.org/me/cut-ins/",
    ],
)
def test_code_is_linked_at_the_commit_of_the_results(answers, origin):
    answers["remote"] = origin
    page = page_of_code(ROOT, ROOT / "workflow" / "Snakefile", 7)
    assert page == f"https://example.org/me/cut-ins/blob/{'ab' * 20}/workflow/Snakefile#L7"


@pytest.mark.parametrize(
    ("command", "answer"),
    [
        ("status", " M workflow/Snakefile"),
        ("remote", subprocess.CalledProcessError(2, "git")),
        ("remote", "/srv/git/cut-ins"),
    ],
)
def test_code_that_no_page_shows_has_no_link(answers, command, answer):
    answers[command] = answer
    assert page_of_code(ROOT, ROOT / "workflow" / "Snakefile", 7) is None
