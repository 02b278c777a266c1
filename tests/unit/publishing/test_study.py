"""One reader of a study, and what notebooks declare that they read and make."""

import json
import math
from pathlib import Path

import IPython.display
import matplotlib.pyplot as plt
import pandas as pd
import pytest
import yaml
from accelerated_evaluation.base.errors import InputError
from accelerated_evaluation.publishing.book.catalogue import read_contents, require_captions
from accelerated_evaluation.publishing.figures.style import FORMATS
from accelerated_evaluation.publishing.published import TITLES, figure, show, table, title_of
from accelerated_evaluation.publishing.study import Study

ROOT = Path(__file__).resolve().parents[3]
NOTEBOOKS = sorted((ROOT / "notebooks").rglob("*.ipynb"))
CONFIG = {
    "study": "made_up",
    "seed": 1,
    "data": {"source": "table", "sample": None, "table": {"description": "made up"}},
    "filters": {},
    "segments": {"lead_speed_edges": []},
    "importance_sampling": {"alpha": 0.2, "beta": 0.1},
}


@figure
def fig99_example(exact, alpha, marker):
    """Two points."""
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
    (results / "contents.json").write_text(json.dumps(["config.json", "exact.csv"]))
    exact = pd.DataFrame({"segment": ["5-15", "all"], "probability": [2.5e-6, 1.23456e-6]})
    exact.to_csv(results / "exact.csv", index=False)
    report = pd.DataFrame(
        {"check": ["speed unit"], "verdict": ["fine"], "seen": [""], "advice": [""], "explained": [False]}
    )
    report.to_csv(results / "records_report.csv", index=False)
    yield Study(results, tmp_path / "figures")
    plt.close("all")


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


def test_a_figure_is_given_what_its_parameters_name_and_published_under_its_own_name(study, monkeypatch):
    shown = show(study, fig99_example, marker="s")
    assert shown.data["alpha"].tolist() == [0.2, 0.2]
    assert {path.name for path in study.figures.iterdir()} == {
        f"fig99_example.{ending}" for ending in (*FORMATS, "csv")
    }
    displayed = []
    monkeypatch.setattr(IPython.display, "display", lambda each, metadata: displayed.append((each, metadata)))
    shown._ipython_display_()
    (above, _), (picture, name), (below, _) = displayed
    assert above.data == '<a id="fig99_example"></a>\n\n**Figure 99.**'
    assert picture.data == (study.figures / "fig99_example.png").read_bytes()
    assert picture.alt == below.data == "Two points."
    assert name == {"image/png": {"published": "fig99_example"}}


def test_a_title_states_the_finding_by_a_rule_and_is_empty_if_a_number_is_not_known(study):
    def title(ratio, low, high):
        row = {"vehicle": "under test", "resolved": True, "median": 1e-6, "ratio": ratio}
        rows = pd.DataFrame([row | {"ratio_low80": low, "ratio_high80": high}])
        return title_of("fig25_vehicles", {"data": rows})

    assert title(0.05, 0.02, 0.09) == "The careful human crashes 20 times as often as the tested vehicle"
    assert title(20, 9, 50) == "The tested vehicle crashes 20 times as often as the careful human"
    assert title(0.5, 0.2, 1.2).endswith("is unclear")
    assert title(math.nan, math.nan, math.nan) == ""
    assert title_of("fig25_vehicles", {"data": pd.DataFrame(columns=["vehicle", "resolved", "median"])}) == ""


def test_every_figure_of_a_chapter_has_a_title():
    titled = yaml.safe_load(TITLES.read_text()).keys()
    chapters = {name for path in NOTEBOOKS if path.stem < "9" for name in read_contents(path).figures}
    assert chapters <= titled
    assert titled <= {name for path in NOTEBOOKS for name in read_contents(path).figures}


def test_a_table_is_published_whole_with_its_source_and_read_as_its_digest(study):
    shown = show(study, example_table)
    saved = pd.read_csv(study.figures / "tables" / "example.csv")
    assert saved["data"].tolist() == ["made up"] * 2
    pd.testing.assert_frame_equal(saved.drop(columns="data"), shown.data)
    markdown = (study.figures / "tables" / "example.md").read_text()
    assert "2.5 × 10⁻⁶" in markdown
    assert "all" not in markdown
    assert "2.5\N{NO-BREAK SPACE}×\N{NO-BREAK SPACE}10⁻⁶" in shown._repr_html_()


def test_a_study_knows_what_was_read_and_published(study):
    assert study.truth["probability"] == 1.23456e-6
    assert study.table("exact.csv").equals(study.exact)
    show(study, example_table)
    show(study, fig99_example, marker="s")
    assert study.used == (["fig99_example"], ["example"], ["exact.csv", "contents.json", "config.json"])
    with pytest.raises(AttributeError, match="exakt"):
        _ = study.exakt


def test_what_a_study_lacks_is_not_made_even_if_an_earlier_study_left_it_behind(study):
    @table("of_an_option")
    def table_with_an_option(exact, crude=None):
        return exact.assign(has_crude=crude is not None)

    @table("of_a_need")
    def table_with_a_need(exact, crude):
        raise AssertionError

    study.exact.to_csv(study.results / "crude.csv", index=False)
    assert study.has("exact", "seed")
    assert not study.has("exact", "crude")
    assert not show(study, table_with_an_option).data["has_crude"].any()
    assert show(study, table_with_a_need) is None
    assert study.used.tables == ["of_an_option"]
    (study.results / "contents.json").write_text(json.dumps(["exact.csv", "crude.csv"]))
    again = Study(study.results, study.figures)
    assert show(again, table_with_an_option).data["has_crude"].all()


def test_a_study_has_the_notebooks_and_the_parts_for_which_it_makes_all_results(tmp_path):
    path = tmp_path / "n.ipynb"
    parts = [
        {"figures": ["fig2"], "tables": [], "reads": ["b.csv"]},
        {"figures": ["fig3"], "tables": ["t3"], "reads": ["b.csv", "c.csv"]},
    ]
    declared = {"figures": ["fig1"], "tables": ["t1"], "reads": ["a.csv"], "optional": parts}
    path.write_text(json.dumps({"metadata": {"study": declared}}))
    assert read_contents(path, {"b.csv", "c.csv"}.__contains__) is None
    assert read_contents(path, {"a.csv", "c.csv"}.__contains__) == (("fig1",), ("t1",), ("a.csv",))
    assert read_contents(path, {"a.csv", "b.csv"}.__contains__).figures == ("fig1", "fig2")
    assert read_contents(path) == (("fig1", "fig2", "fig3"), ("t1", "t3"), ("a.csv", "b.csv", "c.csv"))
    del parts[1]["tables"]
    path.write_text(json.dumps({"metadata": {"study": declared}}))
    with pytest.raises(InputError, match=r"n\.ipynb, key study"):
        read_contents(path)


@pytest.mark.parametrize("metadata", [{}, {"study": {"figures": [], "reads": ["exact.csv"]}}])
def test_a_notebook_has_to_declare_what_it_reads_and_makes(tmp_path, metadata):
    path = tmp_path / "n.ipynb"
    path.write_text(json.dumps({"metadata": metadata}))
    with pytest.raises(InputError, match=r"n\.ipynb, key study of the metadata: seen the lists"):
        read_contents(path)


def test_every_caption_is_that_of_a_figure_or_table():
    made = [name for path in NOTEBOOKS for name in _made(path)]
    captions = {path.stem for path in (ROOT / "workflow" / "report").glob("*.rst")}
    assert captions - {"workflow", "notebook"} == set(made)
    require_captions(made, ROOT / "workflow" / "report")


def test_a_caption_that_is_missing_and_a_name_that_is_shared_are_errors(tmp_path):
    (tmp_path / "one.rst").write_text("One.")
    with pytest.raises(InputError, match=r"two\.rst"):
        require_captions(["one", "two"], tmp_path)
    with pytest.raises(InputError, match="two uses"):
        require_captions(["one", "one"], tmp_path)


def _made(path):
    contents = read_contents(path)
    return [*contents.figures, *contents.tables]
