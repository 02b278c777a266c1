"""Laws of any scenario: boxes, integrals over them, EM for truncated data, densities and maps."""

import json
import math
from functools import reduce
from itertools import pairwise
from operator import getitem

import numpy as np
import pytest
from accelerated_evaluation import LAWS, Box, InputError, JointLaw, read_law, write_law
from accelerated_evaluation.laws.files import signed
from accelerated_evaluation.laws.joint.copula import GaussianCopula, IndependentVariables
from accelerated_evaluation.laws.joint.expectation_maximisation import _clustered, _maximised
from accelerated_evaluation.laws.joint.kernel import KernelLaw
from accelerated_evaluation.laws.joint.truncated import Normals
from accelerated_evaluation.laws.joint.truncated_normals import TruncatedNormalMixture
from scipy.stats import ks_2samp, multivariate_normal, norm

WHOLE = Box(("a", "b"), (0, 0), (35, 60))
BOX = Box(("speed_mps", "other_mps", "distance_m"), (0.0, -3.0, 0.0), (6.0, 4.0, 50.0))
SIGNIFICANCE = (
    1e-4  # of the tests of Kolmogorov and Smirnov; generators are fixed, so nothing fails by chance
)


def normals(box=BOX):
    """Three components: well inside, half outside, and narrow with a strong correlation."""
    mean = np.array([[3.0, 0.0, 20.0], [-1.0, 2.0, 55.0], [1.0, -2.0, 10.0]])
    deviation = np.array([[1.0, 1.0, 6.0], [2.0, 2.0, 20.0], [1.5, 0.5, 5.0]])
    correlation = np.array([[0.3, 0.0, -0.4], [0.2, -0.3, 0.5], [0.0, 0.95, 0.0]])
    matrix = np.ones((3, 3, 3))
    for k, (a, b, c) in enumerate(correlation):
        matrix[k] = [[1, a, b], [a, 1, c], [b, c, 1]]
    return Normals(mean, matrix * deviation[:, :, None] * deviation[:, None, :], box)


MIXTURE = TruncatedNormalMixture(np.array([0.5, 0.2, 0.3]), normals())
KINDS = {name: kind for name, kind in LAWS.items() if issubclass(kind, JointLaw)}


@pytest.fixture(scope="module")
def laws():
    """One law of each kind, fitted to the same records where it is fitted."""
    x = MIXTURE.draw(80, np.random.default_rng(3))
    fits = {name: kind.fit(x, BOX, np.random.default_rng(4)) for name, kind in KINDS.items()}
    return fits | {"truncated_normals": MIXTURE}


def test_a_box_contains_its_limits_which_may_be_infinite():
    box = Box(("a", "b"), (-np.inf, 0.0), (1.0, np.inf))
    x = np.array([[1.0, 0.0], [-1e9, 1e9], [1.1, 1.0], [0.0, -0.1]])
    assert box.contains(x).tolist() == [True, True, False, False]
    assert box.content()[0] == {"name": "a", "lower": None, "upper": 1.0}
    assert Box.from_content(box.content()) == box
    for lower, upper in [((0.0, 0.0), (1.0, 0.0)), ((0.0,), (1.0,))]:
        with pytest.raises(InputError, match="a lower limit below an upper limit"):
            Box(("a", "b"), lower, upper)
    with pytest.raises(InputError, match=r"Box, argument lower: seen \(0.0, nan\); expected a list"):
        Box(("a", "b"), (0.0, np.nan), (1.0, 1.0))
    with pytest.raises(ValueError, match="need finite limits"):
        Normals(np.zeros((1, 2)), np.eye(2)[None], box)


def integral(density, box=BOX, nodes=64):
    """Integrate over the box by a product of Gauss-Legendre rules."""
    node, weight = np.polynomial.legendre.leggauss(nodes)
    sides = [(low + (high - low) * (node + 1) / 2) for low, high in zip(box.lower, box.upper, strict=True)]
    x = np.stack(np.meshgrid(*sides, indexing="ij"), axis=-1).reshape(-1, box.dimension)
    w = weight / 2
    for _ in range(box.dimension - 1):
        w = np.multiply.outer(w, weight / 2)
    return float(w.ravel() @ density(x)) * np.prod(np.subtract(box.upper, box.lower))


def test_masses_of_the_box_agree_with_those_of_scipy():
    own = MIXTURE.normals
    for mean, covariance, mass in zip(own.mean, own.covariance, own.masses, strict=True):
        generator = np.random.default_rng(1)
        reference = multivariate_normal.cdf(
            BOX.upper, mean, covariance, lower_limit=BOX.lower, abseps=1e-8, releps=1e-8, rng=generator
        )
        assert mass == pytest.approx(reference, rel=1e-5)


def test_moments_within_the_box_agree_with_draws():
    generator, own = np.random.default_rng(2), MIXTURE.normals
    mass, first, second = own.moments()
    assert mass == pytest.approx(own.masses, rel=1e-12)
    for k, (mean, covariance) in enumerate(zip(own.mean, own.covariance, strict=True)):
        x = generator.multivariate_normal(mean, covariance, 200_000)
        x = x[BOX.contains(x)] - mean
        products = x[:, :, None] * x[:, None, :]
        assert np.all(np.abs(x.mean(axis=0) - first[k]) < 5 * x.std(axis=0) / np.sqrt(len(x)))
        error = products.std(axis=0) / np.sqrt(len(x))
        assert np.all(np.abs(products.mean(axis=0) - second[k]) < 5 * error)
        # The moments of the distribution without truncation are wrong by far more than the error.
        assert k == 0 or np.any(np.abs(products.mean(axis=0) - covariance) > 20 * error)


def test_densities_integrate_to_one(laws):
    for name, law in laws.items():
        assert integral(lambda x, law=law: np.exp(law.log_density(x))) == pytest.approx(1, abs=2e-3), name
    outside = np.array([[7.0, 0.0, 20.0]])
    assert all(np.isneginf(law.log_density(outside)).all() for law in laws.values())


def test_a_density_without_the_masses_does_not_integrate_to_one():
    def density(x):
        return MIXTURE.shares @ np.exp(MIXTURE.normals.log_densities(x))

    assert integral(density) == pytest.approx(float(MIXTURE.shares @ MIXTURE.normals.masses), abs=2e-3)
    assert integral(density) < 0.9


def test_the_map_from_normal_scores_has_the_density_of_the_law(laws):
    generator, step = np.random.default_rng(5), 1e-4
    z = generator.standard_normal((40, 3))
    for name, law in laws.items():
        slopes = []
        for j in range(3):
            ends = [law.from_normal_scores(z + sign * step * np.eye(3)[j]) for sign in (-1, 1)]
            change = (ends[1] - ends[0]) / (2 * step)
            assert np.all(np.abs(change[:, :j]) < 1e-6), name  # the map is triangular
            slopes.append(change[:, j])
        log_normal = -0.5 * (z**2).sum(axis=1) - 1.5 * np.log(2 * np.pi)
        expected = log_normal - np.log(slopes).sum(axis=0)
        assert law.log_density(law.from_normal_scores(z)) == pytest.approx(expected, abs=5e-3), name


def test_the_map_agrees_with_draws_and_not_with_those_of_another_law():
    generator, size = np.random.default_rng(6), 3000
    directions = np.vstack([np.eye(3), [1, 1, 0.1], [1, -1, 0.1], [0, 1, -0.1]])
    other = IndependentVariables.fit(MIXTURE.draw(500, generator), BOX, generator)
    x, z = MIXTURE.draw(size, generator), generator.standard_normal((size, 3))
    mapped, wrong = MIXTURE.from_normal_scores(z), other.from_normal_scores(z)
    assert min(ks_2samp(x @ v, mapped @ v).pvalue for v in directions) > SIGNIFICANCE
    assert min(ks_2samp(x @ v, wrong @ v).pvalue for v in directions) < SIGNIFICANCE


def test_far_normal_scores_stay_in_the_box(laws):
    z = np.vstack([np.full(3, 9.0), np.full(3, -9.0), [30, -30, 0], [0, 0, 0]])
    for law in laws.values():
        x = law.from_normal_scores(z)
        assert BOX.contains(x).all()
        assert np.all(x[0] > x[3])


def test_one_component_has_the_moments_of_the_records():
    """The likelihood of an exponential family is largest where its moments are those of the records."""
    truth = TruncatedNormalMixture(np.ones(1), Normals(normals().mean[1:2], normals().covariance[1:2], BOX))
    x = truth.draw(4000, np.random.default_rng(7))
    law = TruncatedNormalMixture.fit(x, BOX, np.random.default_rng(8), components=1)
    assert law.fitted.converged
    _, first, _ = law.normals.moments()
    assert law.normals.mean[0] + first[0] == pytest.approx(x.mean(axis=0), rel=0.01)
    assert law.log_density(x).sum() == pytest.approx(law.fitted.log_likelihood)
    assert 0 < law.log_density(x).sum() - truth.log_density(x).sum() < 20  # half a chi-square of 9 degrees
    plain = TruncatedNormalMixture(np.ones(1), Normals(x.mean(axis=0)[None], np.cov(x.T)[None], BOX))
    assert plain.log_density(x).sum() < truth.log_density(x).sum() - 20  # EM that ignores the truncation


def test_a_mixture_is_found_again():
    generator = np.random.default_rng(9)
    x, fresh = MIXTURE.draw(4000, generator), MIXTURE.draw(20_000, generator)
    law = TruncatedNormalMixture.fit(x, BOX, generator, components=3)
    loss = MIXTURE.log_density(fresh) - law.log_density(fresh)
    # Half a chi-square of 29 degrees of freedom is expected, 14.5 nats for 4,000 records.
    assert loss.mean() < 35 / 4000 + 4 * loss.std() / np.sqrt(loss.size)
    fewer = TruncatedNormalMixture.fit(x, BOX, generator, components=1)
    assert (MIXTURE.log_density(fresh) - fewer.log_density(fresh)).mean() > 0.1
    assert fewer.fitted.aic > law.fitted.aic
    assert np.sort(law.shares) == pytest.approx(np.sort(MIXTURE.shares), abs=0.06)


def test_the_step_of_the_em_algorithm_never_lowers_the_likelihood():
    generator = np.random.default_rng(10)
    x = MIXTURE.draw(500, generator) / [1.0, 1.0, 10.0]
    box = Box(BOX.names, (0.0, -3.0, 0.0), (6.0, 4.0, 5.0))
    state, values = _clustered(x, box, 3, generator), []
    for _ in range(40):
        state = _maximised(x, np.ones(len(x)), state, state.mass)
        values.append(state.value)
    assert all(later > earlier - 1e-9 for earlier, later in pairwise(values))
    assert values[-1] > values[0]


def test_weights_count_like_repeated_records():
    generator = np.random.default_rng(11)
    x = MIXTURE.draw(300, generator)
    times = generator.integers(0, 3, len(x))
    start = TruncatedNormalMixture.fit(x, BOX, generator, components=2)
    own = TruncatedNormalMixture.fit(x, BOX, generator, weights=times.astype(float), start=start)
    repeated = TruncatedNormalMixture.fit(np.repeat(x, times, axis=0), BOX, generator, start=start)
    place = MIXTURE.draw(200, generator)
    assert own.log_density(place) == pytest.approx(repeated.log_density(place), abs=0.05)


def test_parameters_are_counted_as_10_k_minus_1():
    law = TruncatedNormalMixture.fit(
        MIXTURE.draw(300, np.random.default_rng(0)), BOX, np.random.default_rng(0)
    )
    assert law.n_parameters == 10 * 4 - 1
    assert law.fitted.aic == pytest.approx(2 * 39 - 2 * law.fitted.log_likelihood)
    assert law.fitted.bic == pytest.approx(np.log(300) * 39 - 2 * law.fitted.log_likelihood)


def test_a_copula_finds_the_correlation_of_the_scores():
    generator = np.random.default_rng(12)
    law = GaussianCopula.fit(MIXTURE.draw(500, generator), BOX, generator)
    known = np.array([[1, 0.6, 0.0], [0.6, 1, -0.3], [0.0, -0.3, 1]])
    truth = GaussianCopula(BOX, law.margins, known)
    found = GaussianCopula.fit(truth.draw(4000, generator), BOX, generator, start=truth)
    assert found.correlation == pytest.approx(known, abs=5 / np.sqrt(4000))


def test_a_repeated_row_does_not_make_kernels_narrow():
    x = MIXTURE.draw(200, np.random.default_rng(13))
    once = KernelLaw.fit(x, BOX, np.random.default_rng(0))
    twice = KernelLaw.fit(np.vstack([x, x]), BOX, np.random.default_rng(0))
    width = [np.linalg.det(law.normals.covariance[0]) for law in (once, twice)]
    assert 0.3 < width[1] / width[0] < 3


def test_damaged_files_are_refused(tmp_path):
    path = tmp_path / "law.json"
    for place, value, seen in (
        (("covariance", 0, 0), -1.0, "LinAlgError"),
        (("covariance", 0, 1), 99.0, "not symmetric"),
        (("covariance", 0, 1), None, "infinite or not a number"),
        (("share",), math.nan, "infinite or not a number"),
        (("share",), 0.9, "instead of 1"),
        (("mean", 0), "x", "a value is no number"),
    ):
        write_law(path, MIXTURE)
        content = json.loads(path.read_text())
        *folders, last = place
        reduce(getitem, folders, content["components"][0])[last] = value
        del content["checksum"]  # which would notice any change
        path.write_text(json.dumps(signed(content)))
        with pytest.raises(InputError, match=f"{seen}.*expected a complete law file"):
            read_law(path)
    with pytest.raises(InputError, match="law"):
        read_law(tmp_path / "absent.json")


def test_a_record_outside_the_box_is_named():
    x = MIXTURE.draw(50, np.random.default_rng(15))
    x[7, 1] = 9
    for kind in KINDS.values():
        with pytest.raises(InputError, match=r"row 8.*other_mps = 9"):
            kind.fit(x, BOX, np.random.default_rng(0))


def test_limits_that_are_whole_numbers_are_those_of_floats():
    """With limits of integers, arrays of brackets would be truncated, and slow speeds drawn too often."""
    assert Box(("a", "b"), (0.0, 0.0), (35.0, 60.0)) == WHOLE
    mean, covariance = np.array([[14.0, 3.7]]), np.array([[[25.0, 3.0], [3.0, 7.6]]])
    z = np.random.default_rng(1).standard_normal((200, 2))
    law = TruncatedNormalMixture(np.ones(1), Normals(mean, covariance, WHOLE))
    x = law.from_normal_scores(z)
    low = np.zeros(len(x))
    below = law.log_slice(1, x, low, x[:, 1]) - law.log_slice(1, x, low, np.full(len(x), 60.0))
    assert below == pytest.approx(norm.logcdf(z[:, 1]), abs=1e-6)
