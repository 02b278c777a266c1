"""Roots of many functions at once, against SciPy's to the last bit and against a closed form."""

import numpy as np
import pytest
from accelerated_evaluation.laws.distributions.mixture import find_roots
from scipy.optimize import elementwise


def cubic(a):
    """Return a family of functions with the roots cbrt(a), as both finders ask for it."""

    def function(x, index):
        return x * x * x - a[index]

    return function


@pytest.fixture
def problems():
    generator = np.random.default_rng(5)
    a = generator.uniform(-1, 1, 300) ** 9 * 1e6
    root = np.cbrt(a)
    return a, root - generator.exponential(2, 300), root + generator.exponential(2, 300)


def test_roots_are_those_of_scipy_to_the_last_bit(problems):
    a, low, high = problems
    root, is_found = find_roots(cubic(a), low, high)
    scipys = elementwise.find_root(lambda x, a: x * x * x - a, (low, high), args=(a,))
    assert is_found.all()
    assert root.tobytes() == scipys.x.tobytes()
    np.testing.assert_allclose(root, np.cbrt(a), rtol=1e-13)
    assert (root != np.cbrt(a)).any()  # the last bits tell how it was found


def test_without_a_change_of_sign_there_is_no_root(problems):
    a, low, high = problems
    for wrong in ((high, high + 1), (low, np.where(a > 0, np.inf, high))):
        root, is_found = find_roots(cubic(a), *wrong)
        scipys = elementwise.find_root(lambda x, a: x * x * x - a, wrong, args=(a,))
        np.testing.assert_array_equal(is_found, scipys.success)
        np.testing.assert_array_equal(root, np.where(scipys.success, scipys.x, np.nan))
    assert not find_roots(cubic(a), high, high + 1)[1].any()


def test_an_end_may_be_the_root():
    a = np.array([8.0, 27.0])
    root, is_found = find_roots(cubic(a), np.array([2.0, 1.0]), np.array([5.0, 3.0]))
    assert is_found.all()
    assert root.tolist() == [2.0, 3.0]


def test_nothing_is_asked_for():
    root, is_found = find_roots(cubic(np.empty(0)), np.empty(0), np.empty(0))
    assert root.shape == is_found.shape == (0,)
