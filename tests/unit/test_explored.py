"""Tests of the lines from which the explorer computes answers."""

import numpy as np
from accelerated_evaluation.answer.explored import NODES, SPEEDS, closing_speeds


def test_a_cell_without_probability_has_finite_closing_speeds():
    """Smooth laws of rounded ranges have no probability between two multiples of the rounding."""
    survival = np.stack([np.zeros(SPEEDS.size), 0.01 * np.exp(-SPEEDS / 2)])
    speeds = closing_speeds(survival, NODES)
    assert np.all(speeds[0] == 0)
    np.testing.assert_allclose(speeds[1], 2 * NODES, atol=1e-6)
