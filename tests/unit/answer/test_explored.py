"""The lines from which the explorer computes answers: their probabilities under each draw of the law."""

from types import SimpleNamespace

import numpy as np
import pytest
from accelerated_evaluation.answer.ways.explored import Plane, PlaneCells, explored_lines, log_ratios
from accelerated_evaluation.answer.ways.explored_cut_ins import SPEEDS, CutInSections
from accelerated_evaluation.answer.ways.explored_slices import SlicedSections
from accelerated_evaluation.base.errors import InputError
from accelerated_evaluation.laws.draws import DrawnLaws, OneLaw
from accelerated_evaluation.laws.joint.truncated import Normals
from accelerated_evaluation.laws.joint.truncated_normals import TruncatedNormalMixture
from accelerated_evaluation.laws.protocol import Box
from accelerated_evaluation.scenarios import SCENARIOS
from scipy.interpolate import make_interp_spline

LEFT_TURN = SCENARIOS["left_turn"]


def test_a_cell_without_probability_has_finite_closing_speeds():
    """Smooth laws of rounded ranges have no probability between two multiples of the rounding."""
    survival, law = (
        np.stack([np.zeros(SPEEDS.size), 0.01 * np.exp(-SPEEDS / 2)]),
        CutInSections.__new__(CutInSections),
    )
    speeds = law.along(survival, law.nodes)
    assert np.all(speeds[0] == 0)
    np.testing.assert_allclose(speeds[1], 2 * law.nodes, atol=1e-6)


def test_cells_fill_their_plane():
    cells = PlaneCells.all(Plane((5.0, 0.0), (35.0, 75.0)))
    assert cells.area.sum() == pytest.approx(30 * 75, rel=1e-12)
    first, second = cells.point
    np.testing.assert_allclose(cells.plane.at(*cells.plane.coordinates(first, second)), [first, second])


def of_means(*means):
    """Return a normal law with standard deviations 4, 3 and 20 around each of the means, and their draws."""
    box = Box(LEFT_TURN.names, *map(tuple, LEFT_TURN.limits.T))
    deviations = np.diag([16.0, 9.0, 400.0])
    laws = [
        TruncatedNormalMixture(np.ones(1), Normals(np.array([mean]), deviations[None], box)) for mean in means
    ]
    base = TruncatedNormalMixture(
        np.full(len(means), 1 / len(means)),
        Normals(np.array(means), np.array([deviations] * len(means)), box),
    )
    return DrawnLaws([OneLaw(law, f"law {k}") for k, law in enumerate(laws)], base)


def short_and_slow(first, second, distance):
    """Return whether the distance is between 4 and 8 m and the turning speed below 5 m/s."""
    return (second < 5) & (distance > 4) & (distance < 8)


def sums(law, lines, logs):
    """Return the probability of `short_and_slow` under each draw as on the page, but in narrower strata."""
    hazards = np.arange(0, law.depth, 0.02)
    first, second = lines.cells.point
    nodes = np.sqrt((hazards + 0.01) * law.depth)
    values = make_interp_spline(np.arange(law.depth + 1), lines.along, axis=1)(nodes)
    flags = short_and_slow(first[:, None], second[:, None], values).astype(float)
    changes = np.diff(flags, axis=1, prepend=0) * np.exp(-hazards) * lines.probability[:, None]
    between = make_interp_spline(np.array(law.levels, float), logs[:, 0], axis=2)
    return np.array([(changes * np.exp(draw)).sum() for draw in between(hazards)])


def test_lines_of_slices_give_the_probability_under_every_draw():
    draws = of_means((14.0, 6.0, 50.0), (12.0, 4.0, 30.0), (16.0, 9.0, 60.0))
    law = SlicedSections(draws, LEFT_TURN)
    lines = explored_lines(law, [short_and_slow], np.random.default_rng(4))
    found = sums(law, lines, log_ratios(law, lines))
    x = np.full((1, 3), 5.0)
    slow, low, high = np.array([5.0]), np.array([4.0]), np.array([8.0])
    expected = [
        np.exp(  # the three variables are independent
            each.log_slice(2, x, low, high)
            - each.log_slice(2, x, 0 * low, 0 * low + 150)
            + each.log_slice(1, x, 0 * slow, slow)
            - each.log_slice(1, x, 0 * slow, 0 * slow + 60)
        )[0]
        for each in draws.laws
    ]
    # Over eight seeds the standard deviation was 1.3, 0.9 and 2.2 %.
    np.testing.assert_allclose(found, expected, rtol=0.07)
    assert np.log(found / expected).mean() == pytest.approx(0, abs=0.04)
    assert max(expected) > 3 * min(expected)
    wrong = sums(law, lines, 0 * log_ratios(law, lines))  # without the ratios, all draws are the base law
    assert np.ptp(wrong) == pytest.approx(0)


def test_a_scenario_without_a_variable_to_scan_has_no_lines():
    draws = SimpleNamespace(laws=(), proposal=None)
    with pytest.raises(InputError, match=r"few intervals.*compare the answers"):
        SlicedSections(draws, SCENARIOS["pedestrian"])
