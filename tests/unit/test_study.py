"""One reader of a study, and how the workflow finds out what notebooks read and make."""

import json
import math
from pathlib import Path

import matplotlib.pyplot as plt
import nbformat
import pandas as pd
import pytest
from accelerated_evaluation.base.errors import InputError
from accelerated_evaluation.publishing.book.catalogue import read_contents, require_captions
from accelerated_evaluation.publishing.figures.style import FORMATS
from accelerated_evaluation.publishing.published import figure, show, table
from accelerated_evaluation.publishing.study import Study

ROOT = Path(__file__).resolve().parents[2]
NOTEBOOKS = sorted((ROOT / "notebooks").rglob("*.ipynb"))
CONFIG = {
    "study": "made_up",
    "seed": 1,
    "data": {"source": "table", "sample": None, "table": {"description": "made up"}},
    "importance_sampling": {"alpha": 0.2, "beta": 0.1},
}


@figure
def fig99_example(exact, alpha, marker):
    drawn, axes = plt.subplots()
    axes.plot(exact["probability"], marker=marker)
    return drawn, exact.assign(alpha=alpha)


@table("example", digits=2, digest=lambda made: made.head(1))
def example_table(exact):
    return exact


@pytest.fixture
def study(tmp_path):
    results = tmp_path / "results" / "made_up"
    results.mkdir(parents=True)
    (results / "config.json").write_text(json.dumps(CONFIG))
    exact = pd.DataFrame({"segment": ["5-15", "all"], "probability": [2.5e-6, 1.23456e-6]})
    exact.to_csv(results / "exact.csv", index=False)
    report = pd.DataFrame(
        {"check": ["speed unit"], "verdict": ["fine"], "seen": [""], "advice": [""], "explained": [False]}
    )
    report.to_csv(results / "records_report.csv", index=False)
    yield Study(results, tmp_path / "figures")
    plt.close("all")


def notebook(path, *cells):
    """Write a notebook that imports two published things, and has these cells of code."""
    imports = [
        "from accelerated_evaluation.publishing.figures.searches import fig08_thresholds",
        "from accelerated_evaluation.publishing.tables.exact import exact_table",
    ]
    cells = [nbformat.v4.new_code_cell(code) for code in (*imports, *cells)]
    nbformat.write(nbformat.v4.new_notebook(cells=cells), path)
    return path


def test_a_result_is_read_once_and_kept(study):
    exact = study.exact
    (study.results / "exact.csv").unlink()
    assert study.exact is exact
    assert study.truth["probability"] == 1.23456e-6
    assert study.headline == "Study **made_up**. Data: made up. Root seed 1."


@pytest.mark.parametrize("name", ["NaN", "007", "1e5", "null"])
def test_a_study_may_be_called_like_a_number_or_like_none(tmp_path, name):
    folder = tmp_path / name
    folder.mkdir()
    (folder / "estimates_course.csv").write_text(f"study,scope,method\n{name},all,crude\n")
    assert Study(folder, tmp_path).course["study"].tolist() == [name]


def test_a_missing_result_says_which_command_makes_it(study):
    with pytest.raises(
        InputError, match=r"estimates\.csv: seen no such file.*snakemake --cores 2 .*estimates"
    ):
        _ = study.estimates


def test_a_figure_is_given_what_its_parameters_name_and_published_under_its_own_name(study):
    shown = show(study, fig99_example, marker="s")
    assert shown.data["alpha"].tolist() == [0.2, 0.2]
    assert {path.name for path in study.figures.iterdir()} == {
        f"fig99_example.{ending}" for ending in (*FORMATS, "csv")
    }
    png, metadata = shown._repr_png_()
    assert png == (study.figures / "fig99_example.png").read_bytes()
    assert metadata["width"] > 0


def test_a_table_is_published_whole_with_its_source_and_read_as_its_digest(study):
    shown = show(study, example_table)
    saved = pd.read_csv(study.figures / "tables" / "example.csv")
    assert saved["data"].tolist() == ["made up"] * 2
    pd.testing.assert_frame_equal(saved.drop(columns="data"), shown.data)
    markdown = (study.figures / "tables" / "example.md").read_text()
    assert "2.5 × 10⁻⁶" in markdown
    assert "all" not in markdown
    assert "2.5 × 10⁻⁶" in shown._repr_html_()


def test_what_a_notebook_reads_and_makes_follows_from_its_code(tmp_path):
    path = notebook(
        tmp_path / "n.ipynb",
        "show(study, fig08_thresholds, segment=study.first_segment)",
        "show(study, exact_table)\nstudy.truth, study.results",
    )
    contents = read_contents(path)
    assert contents.figures == ("fig08_thresholds",)
    assert contents.tables == ("exact",)
    # The trace for the figure, the laws for the name of the segment, the configuration for the source.
    models = {f"models/{name}.json" for name in ("single", "three_pieces", "two_pieces")}
    expected = {"config.json", "cross_entropy_trace.csv", "exact.csv", "encounters.parquet", *models}
    assert set(contents.reads) == expected
    assert len(contents.reads) == len(expected)


def test_a_notebook_reads_a_new_table_by_the_name_of_its_file(tmp_path, study):
    made = notebook(tmp_path / "n.ipynb", "show(study, exact_table)", 'study.table("new/result.csv")')
    assert set(read_contents(made).reads) == {"config.json", "exact.csv", "new/result.csv"}
    assert study.table("exact.csv").equals(study.exact)
    with pytest.raises(AttributeError, match="exakt"):
        _ = study.exakt


@pytest.mark.parametrize(
    ("code", "seen"),
    [
        ("show(study, fig08_threshold)", "fig08_threshold, which is not a registered"),
        ("show(study, fig08_thresholds)", "study.segment, or a parameter segment"),
        ("study.exakt", "study.exakt"),
    ],
)
def test_a_mistyped_name_is_an_error_before_anything_runs(tmp_path, code, seen):
    with pytest.raises(InputError) as error:
        read_contents(notebook(tmp_path / "n.ipynb", code))
    assert error.value.seen.startswith(seen)


def test_every_notebook_reads_what_the_reader_has_and_every_caption_is_used():
    slow = sorted((ROOT / "notebooks/slow").glob("*.ipynb"))  # of another book, with figures of this one
    of_slow = [name for path in slow for name in _made(path)]
    made = [name for path in NOTEBOOKS if path not in slow for name in _made(path)]
    captions = {path.stem for path in (ROOT / "workflow" / "report").glob("*.rst")}
    assert captions - {"workflow", "notebook"} == {*made, *of_slow}
    for names in (made, of_slow):
        require_captions(names, ROOT / "workflow" / "report")


def test_a_caption_that_is_missing_and_a_name_that_is_shared_are_errors(tmp_path):
    (tmp_path / "one.rst").write_text("One.")
    with pytest.raises(InputError, match=r"two\.rst"):
        require_captions(["one", "two"], tmp_path)
    with pytest.raises(InputError, match="two uses"):
        require_captions(["one", "one"], tmp_path)


def test_what_a_notebook_was_found_to_read_is_all_that_its_figures_touch(study, monkeypatch):
    """The files that the code names are those that running it opens."""
    opened = []
    path = Study.path
    monkeypatch.setattr(
        Study, "path", lambda self, name, **parts: opened.append(name) or path(self, name, **parts)
    )
    fresh = Study(study.results, study.figures)
    assert math.isclose(fresh.truth["probability"], 1.23456e-6)
    show(fresh, example_table)
    assert sorted(set(opened)) == ["config.json", "exact.csv"]


def _made(path):
    contents = read_contents(path)
    return [*contents.figures, *contents.tables]
