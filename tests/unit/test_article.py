"""The article: no number of a result is typed, numbers are written as elsewhere, odd studies get one too."""

import copy
import json
import re
import shutil
from pathlib import Path

import numpy as np
import pytest
import typst
from accelerated_evaluation import InputError, StudyError
from accelerated_evaluation.base.files import write_json
from accelerated_evaluation.publishing.article.pdf import Sources, compile_text, numbers_of, write_article
from accelerated_evaluation.publishing.article.tables import TEXT, Tables, plain, shown_figures
from accelerated_evaluation.publishing.study import Study
from accelerated_evaluation.publishing.texts import number, percent, unbroken
from accelerated_evaluation.study.configuration import load
from printed_figures import PUBLISHED, write_pdf
from scipy.stats import poisson

ROOT = Path(__file__).resolve().parents[2]
ARTICLE = ROOT / "article"
SOURCES = Sources(ARTICLE, ROOT / "benchmarks" / "results", ROOT / "workflow" / "report")

# Digits that are no result: names, how many digits a number gets, and paths and labels of the numbers.
ALLOWED = (
    r"//.*",  # comments
    r"decimals: \d|digits: \d|level: \d",
    r"\b[a-z]\w*(\.\w+)+",  # n.answer.crash.low80
    r'"fig\d\d_\w+"|<[\w-]+>|@[\w-]+',
    r"100-Car|UN Regulation No\. 157|SHA-256",
    r"\$[^$]*\$",  # formulas, checked on their own
    r"\d+(\.\d+)?(fr|pt|em|%)|luma\(\d+\)|width: \d+%",  # lengths
    r"== 0|> 0|percent\(0\.95\)",  # comparisons, and the level of a quantile
)


def typed_numbers(text: str) -> list[str]:
    """Return the numbers that a text in the language of Typst states by itself."""
    formulas = re.findall(r"\$([^$]*)\$", text)
    for pattern in ALLOWED:
        text = re.sub(pattern, "", text)
    return [*re.findall(r"\d[\d.,]*", text), *re.findall(r"\d\d+|\d\.\d", " ".join(formulas))]


def test_no_number_of_a_result_is_typed():
    assert typed_numbers((ARTICLE / TEXT).read_text()) == []


def test_no_semicolon_follows_a_number():
    """It would end the code in front of it, and not be printed."""
    assert not re.findall(r"#[a-z][\w.-]*(?:\([^()]*\))?;", (ARTICLE / TEXT).read_text())


@pytest.mark.parametrize(
    ("text", "typed"),
    [
        ("The median is 3.2e-06.", ["3.2", "06."]),
        ("It needs 178 simulations, not #number(n.sampler.piecewise).", ["178"]),
        ("$p = 0.25$", ["0.2"]),
        ("#number(n.answer.crash.low80, decimals: 2) of $x^2$, see @tab-1", []),
    ],
)
def test_a_typed_number_is_found(text, typed):
    assert typed_numbers(text) == typed


@pytest.fixture(scope="module")
def study(tmp_path_factory):
    """The published tables and figures of the default study, and its configuration."""
    results = tmp_path_factory.mktemp("results") / "spmd"
    write_json(results / "config.json", load())
    figures = tmp_path_factory.mktemp("figures")
    shutil.copytree(PUBLISHED / "tables", figures / "tables")
    for name in shown_figures(ARTICLE):
        write_pdf(name, figures)
    return Study(results, figures)


@pytest.fixture(scope="module")
def numbers(study):
    return numbers_of(study, SOURCES)


def folder_with(numbers, folder):
    """Return a folder in which Typst can compile the text."""
    shutil.copytree(ARTICLE, folder)
    (folder / "figures").mkdir()
    for name in shown_figures(ARTICLE):
        write_pdf(name, folder / "figures")
    write_json(folder / "numbers.json", numbers)
    return folder


def words(node) -> str:
    """Return the text in a part of a document that Typst describes as JSON."""
    if isinstance(node, list):
        return "".join(map(words, node))
    if not isinstance(node, dict):
        return ""
    if node.get("func") == "space":
        return " "
    parts = (value for key, value in node.items() if key in ("children", "body", "child", "text"))
    return "".join(value if isinstance(value, str) else words(value) for value in parts)


def paragraphs(numbers, folder) -> str:
    """Return the running text of the article that Typst makes with some numbers."""
    root = folder_with(numbers, folder)
    found = json.loads(typst.query(root / TEXT, "par", root=root, ignore_system_fonts=True))
    return " ".join("\n".join(map(words, found)).replace("\N{NO-BREAK SPACE}", " ").split())


@pytest.mark.parametrize("name", ["claims", "answer", "vehicles", "records_report", "sensitivity"])
def test_a_table_of_which_only_the_header_is_left_is_one_message(study, tmp_path, name):
    shutil.copytree(study.figures / "tables", tmp_path / "tables")
    path = tmp_path / "tables" / f"{name}.csv"
    path.write_text(path.read_text().splitlines()[0] + "\n")
    with pytest.raises(InputError, match=rf"{name}.csv.*expected a complete table of a finished study"):
        numbers_of(Study(study.results, tmp_path), SOURCES)


def test_the_same_study_gives_the_same_bytes(study, tmp_path):
    for name in ("one", "two"):
        write_article(study, SOURCES, tmp_path / f"{name}.pdf", tmp_path / f"{name}.json")
    assert (tmp_path / "one.pdf").read_bytes()[:5] == b"%PDF-"
    assert (tmp_path / "one.pdf").read_bytes() == (tmp_path / "two.pdf").read_bytes()
    assert (tmp_path / "one.json").read_bytes() == (tmp_path / "two.json").read_bytes()


def test_the_text_follows_the_numbers(numbers, tmp_path):
    text = paragraphs(numbers, tmp_path / "as_published")
    assert f"gives {unbroken(numbers['exact']['probability'], 4)} with".replace("\xa0", " ") in text
    changed = copy.deepcopy(numbers)
    changed["exact"]["probability"] = 5.5e-5
    assert "gives 5.5 × 10⁻⁵ with" in paragraphs(changed, tmp_path / "changed")


def test_numbers_are_written_as_in_the_book(tmp_path):
    generator = np.random.default_rng(1)
    values = [0.0, 1.0, 7840.0, 999.96, 0.0009995, 9.996e-7, 5.5e7, 1e6, None, 123456, -0.126]
    values += list(10.0 ** generator.uniform(-12, 12, 60))
    shutil.copy(ARTICLE / "style.typ", tmp_path)
    write_json(tmp_path / "values.json", values)
    (tmp_path / "main.typ").write_text(
        '#import "style.typ": *\n#let values = json("values.json")\n'
        "#metadata(values.map(x => readable(x))) <readable>\n"
        "#metadata(values.map(x => number(x, decimals: 1))) <number>\n"
        "#metadata(values.map(x => percent(x))) <percent>\n"
    )
    nan = [float("nan") if value is None else value for value in values]
    expected = {
        "readable": [unbroken(value) for value in nan],
        "number": [number(value, 1) for value in nan],
        "percent": [percent(value) for value in nan],
    }
    for label, written in expected.items():
        found = typst.query(tmp_path / "main.typ", f"<{label}>", root=tmp_path, field="value", one=True)
        assert [text.replace("−", "-") for text in json.loads(found)] == written, label


def never_crashes(numbers):
    """A vehicle that never crashes, under any law."""
    nothing = dict.fromkeys(numbers["answer"]["crash"], 0)
    numbers["answer"] |= {"crash": nothing, "factor80": None, "rate": 0, "million_km": None, "data": None}
    numbers["answer"]["events"] = [row | dict.fromkeys(row, None) for row in numbers["answer"]["events"]]
    numbers["exact"] |= {"probability": 0, "standard_error": 0, "relative_error": None}
    numbers["laws"] |= {"least": None, "most": None}
    for ends in ("knot", "cap"):
        numbers["choices"][ends] |= {"low": 0, "high": 0, "factor": None}
    for row in (*numbers["vehicles"]["rows"], numbers["vehicles"]["tested"]):
        row |= {"median": 0, "ratio": None, "ratio_low80": None, "ratio_high80": None}
    numbers["injuries"] |= {"rows": [], "human": None}


def map_not_reliable(numbers):
    """A crash map that the replayed records contradict: there is no probability at all."""
    never_crashes(numbers)
    numbers["answer"]["crash"] = dict.fromkeys(numbers["answer"]["crash"])
    numbers["vehicles"]["tested"]["resolved"] = False
    numbers["vehicles"]["rows"][0] |= {"resolved": False, "median": None}


def no_exposure(numbers):
    """Records of an unknown distance: there are no rates, and counts cannot be compared."""
    numbers["answer"] |= {"rate": None, "million_km": None}
    numbers["injuries"]["per"] = "cut-in"
    nothing = {"tested": None, "human": None, "driver": None, "too_many": [], "compatible": []}
    numbers["counted"] |= {"known": False} | nothing


def another_vehicle(numbers):
    """A study that is no reproduction, of a vehicle that is not compared with the careful human."""
    numbers["study"] |= {"departure": "vehicle.name is mine", "vehicle": "mine"}
    numbers["vehicles"]["human"] = False
    numbers["injuries"]["human"] = None
    numbers["counted"]["human"] = None


def faulty_records(numbers):
    """Records with a fault that stops the study."""
    numbers["records"]["stop"] = ["speed unit"]


@pytest.mark.parametrize(
    ("change", "said", "not_said"),
    [
        (never_crashes, "so that we report no probability", "The median is"),
        (map_not_reliable, "contradicts the replayed records", "The median is"),
        (no_exposure, "there are no rates per kilometre", "million kilometres"),
        (another_vehicle, "This study departs from the paper: vehicle.name is mine", "We repeat their study"),
        (faulty_records, "The check speed unit says that the results must not be trusted", "\0"),
    ],
)
def test_absent_parts_are_named(numbers, tmp_path, change, said, not_said):
    assert said not in paragraphs(numbers, tmp_path / "usual")
    changed = copy.deepcopy(numbers)
    change(changed)
    text = paragraphs(changed, tmp_path / change.__name__)
    assert said in text
    assert not_said not in text
    assert not re.search(r"#\w|none of none|NaN|nan ", text)  # code that was not run, or a missing number
    compile_text(tmp_path / change.__name__, tmp_path / "article.pdf")


def test_a_second_set_of_records_refutes_the_answer_as_seldom_as_stated(numbers):
    """Under each end of the interval, one set in forty has more crashes than stated, or none."""
    again, crash = numbers["answer"]["again"], numbers["answer"]["crash"]
    expected = again["size"] * crash["high95"]
    assert poisson.sf(again["most"], expected) <= 0.025 < poisson.sf(again["most"] - 1, expected)
    assert poisson.cdf(0, again["none"] * crash["low95"]) == pytest.approx(0.025, rel=1e-4)
    assert poisson.cdf(0, again["size"] * crash["low95"]) > 0.5  # no crash among as many refutes nothing


def test_a_missing_table_is_named(tmp_path):
    with pytest.raises(InputError, match=r"answer\.csv: seen no such file"):
        Tables(tmp_path)["answer"]


def test_an_error_of_typst_is_reported_and_leaves_no_file(numbers, tmp_path):
    root = folder_with(numbers, tmp_path / "text")
    (root / TEXT).write_text("#no-such-function()")
    with pytest.raises(StudyError, match="unknown variable: no-such-function"):
        compile_text(root, tmp_path / "article.pdf")
    assert not list(tmp_path.glob("*.pdf"))


def test_json_holds_no_missing_number():
    value = {
        "a": np.float64("nan"),
        "b": [np.int64(3), np.inf, True],
        "c": 1.23456789e-7,
        "d": np.bool_(False),
    }
    assert plain(value) == {"a": None, "b": [3, None, True], "c": 1.23457e-7, "d": False}


def test_the_kinds_of_worlds_in_which_the_intervals_fail_are_named(numbers, tmp_path):
    beyond = numbers["worlds"]["beyond"]
    failed = {world["kind"] for world in beyond["failed"]}
    assert "steep end" in failed  # where the hazard rises beyond nearly all records
    assert len(beyond["covered"]) + len(failed) == beyond["kinds"]
    root = folder_with(numbers, tmp_path / "article")
    items = json.loads(typst.query(root / TEXT, "list", root=root, ignore_system_fonts=True))
    text = " ".join(map(words, items))
    assert all(f"{kind}:" in text for kind in failed)
    assert not any(f"{kind}:" in text for kind in beyond["covered"])
