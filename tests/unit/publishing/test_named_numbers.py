"""Named numbers: they follow from published tables, and each says what it is."""

import math
import shutil
from pathlib import Path

import pandas as pd
import pytest
from accelerated_evaluation import InputError
from accelerated_evaluation.base.files import write_json
from accelerated_evaluation.publishing.book.catalogue import tables_of_numbers
from accelerated_evaluation.publishing.named_numbers import (
    COLUMNS,
    NEVER_EMPTY,
    Tables,
    as_names,
    named_numbers,
)
from accelerated_evaluation.publishing.study import Study
from accelerated_evaluation.study.configuration import load

ROOT = Path(__file__).resolve().parents[3]
DEFINITIONS = ROOT / "workflow" / "numbers.yaml"
FIGURES, RESULTS = ROOT / "figures" / "spmd", Tables(ROOT / "benchmarks" / "results")
pytestmark = pytest.mark.skipif(not FIGURES.exists(), reason="the published study is not in this copy")


@pytest.fixture
def study(tmp_path):
    """The default study, with a copy of the published tables from which numbers follow."""
    write_json(tmp_path / "spmd" / "config.json", load())
    (tmp_path / "tables").mkdir()
    for name in tables_of_numbers(DEFINITIONS)["tables"]:
        shutil.copy(FIGURES / "tables" / f"{name}.csv", tmp_path / "tables")
    return Study(tmp_path / "spmd", tmp_path)


def test_the_published_numbers_follow_from_the_published_tables(study):
    published = pd.read_csv(FIGURES / "numbers.csv", dtype=str, keep_default_na=False)
    assert published.columns.tolist() == COLUMNS
    assert published.to_dict("records") == named_numbers(DEFINITIONS, study, RESULTS).to_dict("records")
    assert not published["name"].duplicated().any()
    assert (published != "").all(axis=None)  # an expression with an error would be unknown


def test_numbers_follow_the_tables(study):
    path = study.figures / "tables" / "answer.csv"
    answer = pd.read_csv(path).set_index("event")
    answer.loc["crash", "median"] *= 2
    answer.to_csv(path)
    here, before = (
        as_names(table)
        for table in (named_numbers(DEFINITIONS, study, RESULTS), pd.read_csv(FIGURES / "numbers.csv"))
    )
    assert here.answer_median == pytest.approx(2 * before.answer_median, rel=1e-5)
    assert here.answer_crude == pytest.approx(before.answer_crude / 2, rel=1e-4)
    assert here.answer_mean == before.answer_mean


@pytest.mark.parametrize("name", sorted({*tables_of_numbers(DEFINITIONS)["tables"]} - {*NEVER_EMPTY}))
def test_a_number_whose_row_is_missing_is_unknown(study, name):
    """Of a table that may be empty, such as that of predicted crashes of a vehicle that never crashes."""
    path = study.figures / "tables" / f"{name}.csv"
    path.write_text(path.read_text().splitlines()[0] + "\n")
    numbers = named_numbers(DEFINITIONS, study, RESULTS).set_index("name")["value"]
    assert numbers["answer_median"] != ""
    assert (numbers == "").any() or numbers["injury_curves"] == "0"  # the only count of its table
    assert name != "extrapolation" or numbers["beyond_near"] == numbers["replay_records"] == ""


def test_a_ratio_to_zero_is_unknown(study):
    path = study.figures / "tables" / "answer.csv"
    answer = pd.read_csv(path).set_index("event")
    answer.loc["crash", ["low80", "per_km"]] = 0.0
    answer.to_csv(path)
    numbers = as_names(named_numbers(DEFINITIONS, study, RESULTS))
    assert math.isnan(numbers.answer_factor80)
    assert math.isnan(numbers.answer_million_km)
    assert numbers.answer_per_million_km == 0


@pytest.mark.parametrize("name", ["claims", "answer", "vehicles", "encounters_account", "sensitivity"])
def test_a_table_of_which_only_the_header_is_left_is_one_message(study, name):
    path = study.figures / "tables" / f"{name}.csv"
    path.write_text(path.read_text().splitlines()[0] + "\n")
    with pytest.raises(InputError, match=rf"{name}.csv.*expected a complete table of a finished study"):
        named_numbers(DEFINITIONS, study, RESULTS)


def test_a_missing_table_is_named(study):
    (study.figures / "tables" / "answer.csv").unlink()
    with pytest.raises(InputError, match=r"answer\.csv: seen no such file"):
        named_numbers(DEFINITIONS, study, RESULTS)
