"""The article: no number of a result is typed, and odd studies get one too."""

import copy
import json
import re
import shutil
from pathlib import Path
from types import SimpleNamespace

import pandas as pd
import pytest
import typst
from accelerated_evaluation import StudyError
from accelerated_evaluation.base.files import write_json
from accelerated_evaluation.publishing.article.pdf import (
    Sources,
    compile_text,
    filled_folder,
    names_of,
    write_article,
)
from accelerated_evaluation.publishing.article.text import TEXT, shown_figures
from accelerated_evaluation.publishing.study import Study
from accelerated_evaluation.publishing.texts import unbroken
from accelerated_evaluation.study.configuration import load
from printed_figures import PUBLISHED, write_pdf
from scipy.stats import poisson

ROOT = Path(__file__).resolve().parents[3]
ARTICLE = ROOT / "article"
SOURCES = Sources(ARTICLE, ROOT / "benchmarks" / "results", ROOT / "workflow" / "report")

# Digits that are no result.
ALLOWED = (
    r"//.*",  # comments
    r"\{\{.*?\}\}|\{%.*?%\}",  # placeholders
    r'"fig\d\d_\w+"|<[\w-]+>|@[\w-]+',
    r"100-Car|UN Regulation No\. 157|SHA-256|(?:50|80|90|95)~%",  # names, and levels
    r"\$[^$]*\$",  # formulas, checked on their own
    r"\d+(\.\d+)?(fr|pt|em|%)|luma\(\d+\)|width: \d+%",  # lengths
)


def typed_numbers(text: str) -> list[str]:
    """Return the numbers that a text in the language of Typst states by itself."""
    formulas = re.findall(r"\$([^$]*)\$", text)
    for pattern in ALLOWED:
        text = re.sub(pattern, "", text, flags=re.DOTALL if "{" in pattern else 0)
    return [*re.findall(r"\d[\d.,]*", text), *re.findall(r"\d\d+|\d\.\d", " ".join(formulas))]


def test_no_number_of_a_result_is_typed():
    assert typed_numbers((ARTICLE / TEXT).read_text()) == []


def test_no_semicolon_follows_a_string():
    """It would end the code in front of it, and not be printed."""
    assert not re.findall(r"#\{\{[^}]*\}\};", (ARTICLE / TEXT).read_text())


@pytest.mark.parametrize(
    ("text", "typed"),
    [
        ("The median is 3.2e-06.", ["3.2", "06."]),
        ("It needs 178 simulations, not {{ n.sampler_piecewise | number(2) }}.", ["178"]),
        ("$p = 0.25$", ["0.2"]),
        ("the 80~% interval of {{ n.answer_low80 | readable(2) }} of $x^2$, see @tab-1", []),
    ],
)
def test_a_typed_number_is_found(text, typed):
    assert typed_numbers(text) == typed


@pytest.fixture(scope="module")
def study(tmp_path_factory):
    """The published numbers, tables and figures of the default study, and its configuration."""
    results = tmp_path_factory.mktemp("results") / "spmd"
    write_json(results / "config.json", load())
    figures = tmp_path_factory.mktemp("figures")
    shutil.copytree(PUBLISHED / "tables", figures / "tables")
    shutil.copy(PUBLISHED / "numbers.csv", figures)
    for name in shown_figures(ARTICLE):
        write_pdf(name, figures)
    return Study(results, figures)


@pytest.fixture
def names(study):
    """What the text may use, with numbers and tables that a test may change."""
    known = names_of(study, SOURCES)
    tables = {path.stem: pd.read_csv(path) for path in (study.figures / "tables").glob("*.csv")}
    return known | {"tables": tables, "n": copy.copy(known["n"])}


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


def paragraphs(names, study, folder, of="par") -> str:
    """Return the running text of the article that Typst makes with some names."""
    folder.mkdir()
    filled_folder(folder, names, ARTICLE, study.figures)
    found = json.loads(typst.query(folder / TEXT, of, root=folder, ignore_system_fonts=True))
    return " ".join("\n".join(map(words, found)).replace("\N{NO-BREAK SPACE}", " ").split())


def test_the_same_study_gives_the_same_bytes(study, tmp_path):
    for name in ("one", "two"):
        write_article(study, SOURCES, tmp_path / f"{name}.pdf")
    assert (tmp_path / "one.pdf").read_bytes()[:5] == b"%PDF-"
    assert (tmp_path / "one.pdf").read_bytes() == (tmp_path / "two.pdf").read_bytes()


def test_the_text_follows_the_numbers(names, study, tmp_path):
    text = paragraphs(names, study, tmp_path / "as_published")
    assert f"gives {unbroken(names['n'].exact_probability, 4)} with".replace("\xa0", " ") in text
    names["n"].exact_probability = 5.5e-5
    assert "gives 5.5 × 10⁻⁵ with" in paragraphs(names, study, tmp_path / "changed")


def test_texts_of_tables_are_printed_as_they_are(names, study, tmp_path):
    name = 'my #car "one" \\ $x_1$'
    names["tables"]["vehicles"].loc[1, "vehicle"] = name
    assert name in paragraphs(names, study, tmp_path / "named", of="table")


def unknown(numbers: SimpleNamespace, *beginnings: str) -> None:
    """Make the numbers whose names begin so unknown."""
    for name in vars(numbers):
        if name.startswith(beginnings):
            setattr(numbers, name, float("nan"))


def never_crashes(n, tables):
    """A vehicle that never crashes, under any law."""
    unknown(
        n, "answer_", "beyond_", "replay_", "second_", "ratio_", "laws_least", "laws_most", "exact_relative"
    )
    n.answer_median = n.answer_mean = n.answer_per_million_km = n.exact_probability = 0.0
    n.exact_standard_error = n.knot_low = n.knot_high = n.cap_low = n.cap_high = 0.0
    tables["vehicles"][["ratio", "ratio_low80", "ratio_high80"]] = float("nan")
    for name in ("injuries", "injury_budget", "risk_balance", "extrapolation"):
        tables[name] = tables[name].iloc[:0]


def map_not_reliable(n, tables):
    """A crash map that the replayed records contradict: there is no probability at all."""
    never_crashes(n, tables)
    unknown(n, "answer_")
    tables["vehicles"].loc[0, ["resolved", "median"]] = [False, float("nan")]


def no_exposure(n, tables):
    """Records of an unknown distance: there are no rates, and counts cannot be compared."""
    unknown(n, "answer_per_million_km", "answer_million_km", "counted_tested", "counted_human")
    counted = tables["counted_crashes"]
    tables["counted_crashes"] = counted[counted["kind"] != "predicted"]
    tables["human_predictions"]["expected"] = float("nan")


def another_vehicle(n, tables):
    """A vehicle that is not compared with the careful human."""
    unknown(n, "counted_human")
    tables["vehicles"] = tables["vehicles"].query("vehicle != 'cc_human'")
    tables["risk_balance"] = tables["risk_balance"].query("reference != 'cc_human'")


def faulty_records(n, tables):
    """Records with a fault that stops the study."""
    tables["records_report"].loc[0, ["check", "verdict"]] = ["speed unit", "stop"]


@pytest.mark.parametrize(
    ("change", "said", "not_said"),
    [
        (never_crashes, "so that we report no probability", "The median is"),
        (map_not_reliable, "contradicts the replayed records", "The median is"),
        (no_exposure, "there are no rates per kilometre", "million kilometres"),
        (another_vehicle, "For the vehicle under test", "competent and careful human"),
        (faulty_records, "The check speed unit says that the results must not be trusted", "\0"),
    ],
)
def test_absent_parts_are_named(names, study, tmp_path, change, said, not_said):
    change(names["n"], names["tables"])
    folder = tmp_path / change.__name__
    text = paragraphs(names, study, folder)
    assert said in text
    assert not_said not in text
    assert not re.search(r"#\w|none of none|NaN|nan ", text)  # code that was not run, or a missing number
    compile_text(folder, tmp_path / "article.pdf")


def test_a_study_that_departs_from_the_paper_says_so(names, study, tmp_path):
    names |= {"departure": "vehicle.name is mine"}
    text = paragraphs(names, study, tmp_path / "article")
    assert "This study departs from the paper: vehicle.name is mine" in text
    assert "We repeat their study" not in text


def test_a_second_set_of_records_refutes_the_answer_as_seldom_as_stated(names):
    """Under each end of the interval, one set in forty has more crashes than stated, or none."""
    n = names["n"]
    expected = n.second_size * n.answer_high95
    assert poisson.sf(n.second_most, expected) <= 0.025 < poisson.sf(n.second_most - 1, expected)
    assert poisson.cdf(0, n.second_none * n.answer_low95) == pytest.approx(0.025, rel=1e-4)
    assert poisson.cdf(0, n.second_size * n.answer_low95) > 0.5  # no crash among as many refutes nothing


def test_an_error_of_typst_is_reported_and_leaves_no_file(tmp_path):
    (tmp_path / TEXT).write_text("#no-such-function()")
    with pytest.raises(StudyError, match="unknown variable: no-such-function"):
        compile_text(tmp_path, tmp_path / "article.pdf")
    assert not list(tmp_path.glob("*.pdf"))


def test_the_kinds_of_worlds_in_which_the_intervals_fail_are_named(names, study, tmp_path):
    beyond = pd.read_csv(SOURCES.benchmarks / "worlds.csv").query("beyond")
    fails = beyond["coverage80_high"] < 0.8
    assert "steep end" in set(beyond["kind"][fails])  # where the hazard rises beyond nearly all records
    text = paragraphs(names, study, tmp_path / "article", of="list")
    assert all(f"{kind}:" in text for kind in beyond["kind"][fails])
    assert not any(f"{kind}:" in text for kind in beyond["kind"][~fails])
