"""The file in which a fitted family of laws and its scores are kept."""

import os
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from accelerated_evaluation import InputError, LawStudy
from accelerated_evaluation.answer.candidates import family_file
from accelerated_evaluation.answer.candidates.family_file import fit_or_read, read_family, write_family
from accelerated_evaluation.answer.candidates.smooth_family import SmoothFamily
from accelerated_evaluation.base.extensions import VARIABLE
from accelerated_evaluation.laws.smooth.family import DistinctRecords, members_at
from accelerated_evaluation.laws.smooth.support import SUPPORT

SIZE = 800  # above the highest thresholds there are too few of them


@pytest.fixture(scope="module")
def records():
    generator = np.random.default_rng(1)
    range_ = SUPPORT.range_max * generator.uniform(0.01, 1, SIZE) ** 0.5
    return DistinctRecords(generator.uniform(5, 34.9, SIZE), range_, 2 * generator.standard_exponential(SIZE))


@pytest.fixture(scope="module")
def scored(records):
    return SmoothFamily.of(records, calibrated=True)


@pytest.fixture
def path(tmp_path, scored):
    write_family(tmp_path / "family.npz", scored)
    return tmp_path / "family.npz"


def test_a_family_comes_back_equal(path, records, scored, tmp_path):
    """What is drawn from it is equal too, and written again it gives the same bytes."""
    read = read_family(path, records)
    assert read.members == scored.members
    assert np.array_equal(read.scores, scored.scores)
    assert len(read.members) < len(members_at())
    for level, above in scored.family.exceedances.items():
        assert np.array_equal(read.family.exceedances[level].excess, above.excess)
    one, two = (LawStudy.of_family(each, 20, np.random.default_rng(2)) for each in (read, scored))
    assert np.array_equal(one.weights, two.weights)
    places = records.only(np.arange(50)).places
    for member in scored.members:
        laws = (each.family.law(member).drawn(np.random.default_rng(3)) for each in (read, scored))
        of_read, of_scored = (law.given(places).cumulative(records.closing_speed[:50]) for law in laws)
        assert np.array_equal(of_read, of_scored)
    write_family(tmp_path / "again.npz", read)
    assert (tmp_path / "again.npz").read_bytes() == path.read_bytes()


HEADERS = """
import numpy as np
from accelerated_evaluation.answer.candidates.family_file import _header
from accelerated_evaluation.base.extensions import load_known
from accelerated_evaluation.laws.smooth.family import DistinctRecords

records = DistinctRecords(*np.ones((3, 5)))
before = _header(records)
load_known()
assert before == _header(records)
print(before["code"])
"""


def test_a_file_is_made_by_the_same_code_whether_or_not_extensions_are_already_imported():
    """Otherwise a later rule of a study would fit the family again, and change an input of the others."""
    toy = Path(__file__).parents[2] / "toys/mine/toy_shape.py"
    digests = [
        subprocess.run(
            [sys.executable, "-c", HEADERS],
            env=os.environ | {VARIABLE: value},
            check=True,
            capture_output=True,
            text=True,
        ).stdout
        for value in ("", str(toy))
    ]
    assert digests[0] != digests[1]


def test_refits_of_a_family_that_was_read_are_equal(path, records, scored):
    left_out = np.arange(100)
    read = read_family(path, records)
    refits = (each.fitter.refit(each.family, left_out) for each in (read, scored))
    one, two = (np.concatenate([tail.coefficients for tail in refit.tails.values()]) for refit in refits)
    assert np.array_equal(one, two)


def test_a_family_of_other_records_is_refused(path, records):
    others = replace(records, closing_speed=np.append(records.closing_speed[1:], 1.0))
    with pytest.raises(InputError, match="seen another value of records; expected the family of these rec"):
        read_family(path, others)
    with pytest.raises(InputError, match="another value of records"):
        read_family(path, replace(records, support=replace(SUPPORT, range_max=80.0)))


@pytest.mark.parametrize("damage", ["missing", "no archive", "cut", "another archive"])
def test_what_is_no_family_is_refused(path, records, damage):
    content = path.read_bytes()
    path.unlink()
    if damage == "no archive":
        path.write_text("no archive")
    elif damage == "cut":
        path.write_bytes(content[: len(content) // 2])
    elif damage == "another archive":
        np.savez(path, header=np.array("{}"))
    with pytest.raises(InputError, match=r"expected a family file\. Run the study"):
        read_family(path, records)


def test_a_family_is_fitted_again_only_if_the_file_is_of_no_use(path, records, scored, monkeypatch):
    fitted = []
    monkeypatch.setattr(SmoothFamily, "of", lambda records, **_: fitted.append(records) or scored)
    before = path.read_bytes()
    fit_or_read(path, records)
    assert not fitted
    path.write_text("damaged")
    assert np.array_equal(fit_or_read(path, records).scores, read_family(path, records).scores)
    assert fitted == [records]
    assert path.read_bytes() == before
    monkeypatch.setattr(family_file, "VERSION", family_file.VERSION + 1)
    fit_or_read(path, records)
    assert fitted == [records, records]
