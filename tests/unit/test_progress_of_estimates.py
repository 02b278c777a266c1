"""What `estimate` prints while it simulates."""

from accelerated_evaluation.answer.estimation import _progress
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
