"""The public interface: every name has an example on its page, and the page runs."""

import doctest
import functools
import re
from pathlib import Path

import accelerated_evaluation as ae
import pandas as pd
import pytest

ROOT = Path(__file__).resolve().parents[3]
PAGE = ROOT / "docs" / "interface.md"
BLOCKS = re.findall(r"```python\n(.*?)```", PAGE.read_text(encoding="utf-8"), re.DOTALL)


def test_every_public_name_can_be_imported_and_has_an_example():
    assert 40 <= len(ae.__all__) <= 60
    used = set(re.findall(r"\bae\.(\w+)", "\n".join(BLOCKS)))
    assert used == set(ae.__all__)
    for name in ae.__all__:
        assert getattr(ae, name).__doc__ or name.isupper(), name


CALLABLE = [name for name in ae.__all__ if not name.isupper()]
BEGINNINGS = ("read_records", "choose_draws", "fit_paper_law", "estimate")  # of most examples, and slow


def computed_once(function):
    """Return a function that computes its result once for the same records, and equal other arguments."""
    results = {}

    @functools.wraps(function)
    def of(*arguments):
        key = tuple(id(each) if isinstance(each, ae.FittedRecords) else repr(each) for each in arguments)
        if key not in results:
            results[key] = function(*arguments), arguments  # kept, so that no other object gets their id
        return results[key][0]

    return of


@pytest.fixture(scope="module")
def once():
    """Return the functions with which examples begin, which compute the same for each example once."""
    return {name: computed_once(getattr(ae, name)) for name in BEGINNINGS}


@pytest.mark.parametrize("name", CALLABLE)
def test_every_public_function_and_class_has_an_example_that_runs(name, once, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (found,) = doctest.DocTestFinder(recurse=False).find(getattr(ae, name), name)
    for beginning, function in once.items():
        monkeypatch.setattr(ae, beginning, function)
    assert found.examples, f"{name} has no example"
    assert doctest.DocTestRunner().run(found).failed == 0


def test_a_name_that_is_not_public_is_refused():
    with pytest.raises(AttributeError, match="nothing"):
        ae.nothing  # noqa: B018


def test_the_examples_run_one_after_another(tmp_path, monkeypatch):
    """Every eighth left turn is enough, as the fits of the laws take most of the time."""
    turns = ae.SCENARIOS["left_turn"].records.file
    (tmp_path / turns).parent.mkdir(parents=True)
    pd.read_parquet(ROOT / turns)[::8].to_parquet(tmp_path / turns)
    (tmp_path / "data" / "spmd").symlink_to(ROOT / "data" / "spmd")
    monkeypatch.chdir(tmp_path)
    names = {}
    for block in BLOCKS:
        exec(block, names)
    assert names["found"].converged
    assert 0 < names["exact"].posterior.probability < 1e-4
