"""The rivals on a Gaussian process: their parts against exact answers, and each whole on a half-space."""

import math
import sys
from pathlib import Path

import numpy as np
import pytest
from scipy.special import ndtr
from scipy.stats import gaussian_kde

pytestmark = pytest.mark.studies
ROOT = Path(__file__).resolve().parents[2]
sys.path.append(str(ROOT / "fewruns" / "benchmarks"))
for package in ("openturns", "sklearn"):
    pytest.importorskip(package, reason="needs the extra peers")

import kernel_density  # noqa: E402
import kriging  # noqa: E402
import two_stage  # noqa: E402
from methods import Counter, Target  # noqa: E402
from problems import limit_state  # noqa: E402

EXACT = float(ndtr(-4.0))
HALF_SPACE = limit_state("tilted", "tilted", lambda a, b: 4.0 - 0.6 * a - 0.8 * b, EXACT)


def test_shells_weigh_as_the_normal_law():
    population = kriging.shells(np.random.default_rng(1), 8, 20_000, 2)
    inside = population.z @ [0.6, 0.8] >= 4.0
    found, error = population.estimate(inside)
    assert error < 0.05 * EXACT
    assert found == pytest.approx(EXACT, abs=4 * error)
    assert abs(inside.mean() - EXACT) > 100 * error  # every point alike


def test_first_runs_have_the_density_that_the_estimate_divides_by():
    z = kriging.shells(np.random.default_rng(2), kriging.FIRST, 5000, 3).z
    terms = (z[:, 2] >= 4.0) / kernel_density.shells_ratio(z)
    error = terms.std() / math.sqrt(len(z))
    assert error < 0.1 * EXACT
    assert terms.mean() == pytest.approx(EXACT, abs=4 * error)
    assert kernel_density.shells_ratio(np.array([[0.0, 0.0, 9.0]])) == 0  # beyond the last shell


def test_kernels_have_the_density_that_the_estimate_divides_by():
    generator = np.random.default_rng(3)
    centres = generator.normal([0.0, 4.0], 0.7, (300, 2))
    proposal = kernel_density.Proposal(gaussian_kde(centres.T, "silverman"), 0.1)
    z = proposal.draw(generator, 20_000)
    terms = (z[:, 1] >= 4.0) / proposal.ratio(z)
    error = terms.std() / math.sqrt(len(z))
    assert terms.mean() == pytest.approx(EXACT, abs=4 * error)
    wrong = kernel_density.Proposal(proposal.kernels, 0.4)  # another share of the law of the input
    assert abs(np.mean((z[:, 1] >= 4.0) / wrong.ratio(z)) - EXACT) > 4 * error


def test_entropy_and_front_by_hand():
    entropy = two_stage.entropy(np.array([0.0, 1.0, -1.0, 50.0]), np.ones(4))
    assert entropy[0] == pytest.approx(math.log(2))
    assert entropy[1] == pytest.approx(entropy[2])
    assert entropy[3] == pytest.approx(0.0, abs=1e-12)
    first, second = np.array([3.0, 2.0, 2.0, 1.0]), np.array([1.0, 0.5, 2.0, 2.0])
    assert sorted(two_stage.on_pareto_front(first, second)) == [0, 2]


def test_candidates_of_a_square_are_inside_the_box():
    corners = np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])
    found = two_stage.triangulated(corners)
    assert len(found) == 2 + 4  # two triangles, four sides
    beyond = sorted(found[2:].round(9).tolist())
    half = (two_stage.BOX + 1) / 2
    assert beyond == sorted([[-half, 0.0], [half, 0.0], [0.0, -half], [0.0, half]])


def test_learning_ends_when_all_signs_are_known():
    score = Counter(math.inf).level(HALF_SPACE)
    first = kriging.shells(np.random.default_rng(4), kriging.FIRST, 1, 2).z
    process = kriging.Kriging(score, first, score(first))
    z = kriging.shells(np.random.default_rng(5), kriging.FIRST, 50, 2).z
    means, sure = kriging.learn(process, z)
    assert sure
    np.testing.assert_array_equal(means <= 0, score(z) <= 0)


@pytest.mark.parametrize(
    ("module", "name"),
    [(kriging, "ak_mcs"), (kriging, "ak_is"), (two_stage, "two_stage"), (kernel_density, "kde_ais")],
)
def test_a_method_finds_the_half_space(monkeypatch, module, name):
    monkeypatch.setattr(two_stage, "SIMULATIONS", 50)
    target = Target()
    outcome = getattr(module, name)(HALF_SPACE, np.random.default_rng(6), target)
    assert outcome.converged
    assert outcome.calls <= kernel_density.SIMULATIONS
    # On so plain a boundary the process is right, and the error of the population is all of the error.
    error = (outcome.ci_high - outcome.ci_low) / 2 / target.reach
    assert outcome.probability == pytest.approx(EXACT, abs=4 * error)
    assert 0 < error <= target.cov * outcome.probability
