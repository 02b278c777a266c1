"""The effective number of events, against numbers that are known."""

import numpy as np
import pytest
from fewruns import SeveralLaws
from fewruns.results import event_ratios
from fewruns.weights import effective_number
from sampler_checks import drive, half_plane, new_sampler


def test_the_effective_number_of_known_weights():
    assert effective_number(np.ones((2, 7))) == pytest.approx([7, 7])
    assert effective_number(np.array([3.0, 1.0])) == pytest.approx(16 / 10)
    assert effective_number(np.empty(0)) == 0


def test_an_estimate_reports_the_health_of_its_weights():
    course = drive(new_sampler(), half_plane())
    progress, found = course.sampler.progress, course.result.diagnostics
    one_law = SeveralLaws(lambda z: np.zeros((1, len(z))))
    assert found["effective_events"] == pytest.approx(one_law.effective_events(progress)[0])
    ratios = event_ratios(progress)
    assert 1 < found["effective_events"] < len(ratios) < course.result.events
    # A single event with a dominating weight makes the effective number 1.
    end = len(progress.z)
    for batch in reversed(progress.batches):
        events = np.flatnonzero(progress.happened[end - len(batch.z) : end] & (batch.weight > 0))
        end -= len(batch.z)
        if len(events):
            batch.weight[events[-1]] *= 1e6
            break
    assert effective_number(event_ratios(progress)) == pytest.approx(1, rel=1e-3)
