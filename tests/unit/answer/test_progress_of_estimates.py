"""What `estimate` prints while it simulates."""

import warnings

import pytest
from accelerated_evaluation.answer.estimation import _progress, _remarks
from fewruns import Estimate

REASON = "the estimate begins again"


def known(simulations, low, high):
    return Estimate(0.1, low, high, alpha=0.2, learning=simulations, estimating=0, events=1, converged=False)


def test_an_interval_that_is_lost_is_told_once(capsys):
    with _progress() as (_, show):
        for n, ends in enumerate([(0.0, 1.0), (0.1, 0.2), (0.0, 1.0), (0.0, 1.0), (0.1, 0.2)]):
            estimate = known(10 * n, *ends)
            show(Estimate(**{**vars(estimate), "reason": REASON}), None)
    assert capsys.readouterr().err.count(f"after 20 simulations: {REASON}") == 1
    with _progress() as (_, show):
        show(known(10, 0.0, 1.0), None)
        show(known(20, 0.1, 0.2), None)
    assert "simulations: " not in capsys.readouterr().err


def warned():
    """Return the remarks of three warnings."""
    with _remarks() as remarks:
        for _ in range(2):
            warnings.warn("The vehicle is treated as one with random outcomes.", stacklevel=1)
        warnings.warn("overflow", RuntimeWarning, stacklevel=1)
    return remarks


def test_warnings_of_the_library_become_remarks_of_the_answer():
    """Once each, and without path and source line; warnings of other kinds stay warnings."""
    with pytest.warns(RuntimeWarning, match="overflow") as shown:
        remarks = warned()
    assert remarks == ["The vehicle is treated as one with random outcomes."]
    assert len(shown) == 1
