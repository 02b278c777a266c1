"""Two studies are compared by their settings and by the cells of their published tables."""

import json
import shutil

import pandas as pd
import pytest
from accelerated_evaluation import cli

ANSWER = """study,event,probability,low80,high80,data
{0},crash,{1},1e-06,3e-06,records of {0}
{0},TTC at most 1 s,4e-05,{2},5e-05,records of {0}
"""
ESTIMATES = "study,method,replicate,probability,data\n{0},crude,0,1e-06,r\n{0},crude,1,{1},r\n{2}"


@pytest.fixture
def studies(tmp_path, monkeypatch):
    """Make the working folder that of two studies, a and b, with three different numbers and one more row."""
    monkeypatch.chdir(tmp_path)
    for name, tail, crash, ttc, estimate, row in (
        ("a", "exponential", 2e-6, "", 3e-6, ""),
        ("b", "bounded normal", 5e-6, 3e-5, 3.1e-6, "b,single,0,2e-06,r\n"),
    ):
        (tmp_path / "results" / name).mkdir(parents=True)
        config = {"study": name, "models": {"inverse_ttc": {"tail": tail, "knots": [1, 2]}}}
        (tmp_path / "results" / name / "config.json").write_text(json.dumps(config))
        tables = tmp_path / "figures" / name / "tables"
        tables.mkdir(parents=True)
        (tables / "answer.csv").write_text(ANSWER.format(name, crash, ttc))
        (tables / "empty.csv").write_text("study,event,probability\n")
        (tables / "estimates.csv").write_text(ESTIMATES.format(name, estimate, row))
    return tmp_path


def test_settings_and_cells_that_differ_are_listed(studies, capsys):
    assert cli.main(["compare", "a", "b"]) == 0
    out = capsys.readouterr().out
    assert out.splitlines()[1].split() == ["models.inverse_ttc.tail", "exponential", "bounded", "normal"]
    assert "knots" not in out
    assert "crude" not in out  # only the answer is printed
    table = pd.read_csv(studies / "results/b/compared_with_a.csv")
    found = table.set_index(["table", "row", "column"])
    assert found["ratio"].to_dict() == pytest.approx(
        {
            ("answer", "crash", "probability"): 2.5,
            ("answer", "TTC at most 1 s", "low80"): float("nan"),
            ("estimates", "crude (2)", "probability"): 3.1 / 3,
            ("estimates", "single", "replicate"): float("nan"),
            ("estimates", "single", "probability"): float("nan"),
        },
        nan_ok=True,
    )
    # The logarithm of 2.5, divided by half of that of 3, the width of the interval from 1e-6 to 3e-6.
    assert found.loc[("answer", "crash", "probability"), "half_widths"] == pytest.approx(1.668, abs=1e-3)
    assert found.loc["estimates", "half_widths"].isna().all()
    assert found.loc[("answer", "TTC at most 1 s", "low80"), ["in a", "in b"]].isna().tolist() == [
        True,
        False,
    ]


def test_equal_tables_differ_in_nothing_whatever_the_order_of_rows(studies, capsys):
    shutil.copytree(studies / "results/a", studies / "results/c")
    shutil.copytree(studies / "figures/a", studies / "figures/c")
    answer = studies / "figures/c/tables/answer.csv"
    pd.read_csv(answer)[::-1].to_csv(answer, index=False)
    assert cli.main(["compare", "a", "c", "--target", "out.csv"]) == 0
    assert (
        "The settings are equal.\nThe probabilities are equal.\nout.csv: 0 cells" in capsys.readouterr().out
    )
    assert len(pd.read_csv("out.csv")) == 0


@pytest.mark.parametrize(
    ("names", "message"),
    [
        (["a", "a"], "expected another study than STUDY"),
        (["a", "nope"], "results/nope/config.json"),
        (["a", "empty"], "seen no table of the same name"),
    ],
)
def test_studies_that_cannot_be_compared_are_named(studies, capsys, names, message):
    shutil.copytree(studies / "results/a", studies / "results/empty")
    assert cli.main(["compare", *names]) == 2
    assert message in capsys.readouterr().err
    assert not list(studies.glob("**/compared*"))


def test_studies_of_two_scenarios_are_refused(studies, capsys):
    """Their tables have no row in common, so that no number would differ."""
    path = studies / "results/b/config.json"
    path.write_text(json.dumps(json.loads(path.read_text()) | {"scenario": {"name": "left_turn"}}))
    assert cli.main(["compare", "a", "b"]) == 2
    assert "seen a study of left_turn; expected a study of the scenario cut_in" in capsys.readouterr().err


def test_the_interval_of_an_event_is_printed_next_to_its_probability(studies, capsys):
    tables = studies / "figures/b/tables/answer.csv"
    tables.write_text(ANSWER.format("b", 5e-6, 3e-5).replace("1e-06", "2e-06").replace("4e-05", "6e-05"))
    assert cli.main(["compare", "a", "b"]) == 0
    rows = [line for line in capsys.readouterr().out.splitlines() if line.lstrip().startswith("answer")]
    events = ["crash" in row for row in rows]
    assert len(rows) == 4
    assert events[0] == events[1] != events[2] == events[3]


@pytest.mark.parametrize(
    ("file", "content"),
    [
        *(("results/b/config.json", text) for text in (b"", b"{", b"[]", b"5", b"null", b"{}", b"\xff\xfe")),
        ("results/b/config.json", b'{"study": "b", "scenario": 5}'),
        ("results/b/config.json", b'{"study": "b", "scenario": {"name": "sailing"}}'),
        *(("figures/b/tables/answer.csv", text) for text in (b"", b"\xff\xfe\0", b'event\n"crash')),
    ],
)
def test_a_damaged_result_is_one_message(studies, capsys, file, content):
    (studies / file).write_bytes(content)
    assert cli.main(["compare", "a", "b"]) == 2
    error = capsys.readouterr().err
    assert error.startswith("error: ")
    assert error.count("\n") == 1
    assert not (studies / "results/b/compared_with_a.csv").exists()


@pytest.mark.parametrize("name", ["a/", "../a", "..", "/", "x/a"])
def test_a_path_is_no_name_of_a_study(studies, capsys, name):
    for names in ((name, "a"), ("a", name)):
        assert cli.main(["compare", *names]) == 2
        assert "expected the name of a study" in capsys.readouterr().err
