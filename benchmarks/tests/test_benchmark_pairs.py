"""The ratio of two vehicles from few runs: its coverage counted where the sampling errors are known."""

import sys
from pathlib import Path

import numpy as np
import pytest
from accelerated_evaluation import SampledPosterior

pytestmark = pytest.mark.studies
ROOT = Path(__file__).resolve().parents[2]
sys.path += [str(ROOT / "benchmarks" / "answers")]

from pairs import row_of  # noqa: E402

SIZE, MEMBER, BATCHES = 4000, np.zeros(4000, int), 1000
GENERATOR = np.random.default_rng(3)
EXACT = np.exp(GENERATOR.normal(-1.0, 0.4, SIZE))
OTHER = np.full(SIZE, 1e-5)


def sampled(exact, error, stated):
    """Return estimates with independent relative errors, of which a standard error is stated."""
    found = exact * (1 + error * GENERATOR.standard_normal(SIZE))
    return SampledPosterior(found, MEMBER, np.full(SIZE, stated), BATCHES)


@pytest.mark.parametrize(("stated", "covered"), [(0.1, 0.8), (0.05, 0.48)])
def test_the_interval_of_the_sampling_covers_as_often_as_its_errors_are_right(stated, covered):
    """Errors of 0.1 in both; if half of them is stated, the interval covers 2 Phi(1.28 / 2) - 1 = 0.48."""
    row = row_of(sampled(EXACT * OTHER, 0.1, stated), sampled(OTHER, 0.1, stated), EXACT)
    assert row["covered"] == pytest.approx(covered, abs=0.03)
    assert row["off"] == pytest.approx(0.0, abs=0.03)
    assert row["exact"] == pytest.approx(np.median(EXACT))
    # The estimates vary by the law, by the errors, and by those that are stated for both vehicles.
    width = np.sqrt(0.4**2 + 2 * 0.1**2 + 2 * stated**2) / 0.4
    assert row["widened"] == pytest.approx(width - 1, abs=0.04)
