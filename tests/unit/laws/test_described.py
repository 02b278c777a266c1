"""How distributions describe themselves: registry, units, new bounds, and a new one in a class of its own."""

import math
from dataclasses import fields

import numpy as np
import pytest
from accelerated_evaluation.laws.distributions import (
    DISTRIBUTIONS,
    BoundedExponential,
    BoundedNormal,
    Mixture,
    Pareto,
    PiecewiseMixture,
    from_dict,
    unit_to_power,
)

KINDS = {
    "bounded exponential": BoundedExponential,
    "bounded normal": BoundedNormal,
    "Pareto": Pareto,
    "mixture": Mixture,
    "piecewise mixture": PiecewiseMixture,
}
NORMALS = Mixture((0.3, 0.7), (BoundedNormal(0.03, 0.0, 0.2), BoundedNormal(0.09, 0.0, 0.2)))
PIECES = PiecewiseMixture((0.9, 0.1), (NORMALS, BoundedExponential(21.0, 0.2)))


def test_the_kinds_of_files_written_before_are_known():
    assert {kind: DISTRIBUTIONS[kind] for kind in KINDS} == KINDS
    assert [member.kind for member in DISTRIBUTIONS.values()] == list(DISTRIBUTIONS)


def test_parameters_are_fields_and_bounds_are_not_among_them():
    for member in DISTRIBUTIONS.values():
        assert set(member.parameters) <= {field.name for field in fields(member)} - {"lower", "upper"}
    assert [BoundedExponential(1.0).n_parameters, NORMALS.n_parameters, PIECES.n_parameters] == [1, 3, 5]


@pytest.mark.parametrize(
    ("unit", "power", "expected"),
    [
        ("1/s", -1, "s"),
        ("1/s", 1, "1/s"),
        ("1/s", 0, "1"),
        ("m", -1, "1/m"),
        ("m", 2, "m^2"),
        ("1/m", 2, "1/m^2"),
    ],
)
def test_units_of_parameters_follow_from_that_of_the_variable(unit, power, expected):
    assert unit_to_power(unit, power) == expected


@pytest.mark.parametrize(
    "law", [BoundedExponential(3.0, 0.1, 0.4), BoundedNormal(0.2, 0.1, 0.4), Pareto(1.7, 0.1)]
)
def test_powers_of_parameters_are_those_by_which_they_scale(law):
    c = 1000.0  # as many of the new units make one of the old
    values = {name: getattr(law, name) * c**parameter.power for name, parameter in law.parameters.items()}
    bounds = {name: getattr(law, name) * c for name in ("lower", "upper") if name in vars(law)}
    scaled = type(law)(**values, **bounds)
    x = np.array([0.1, 0.15, 0.3])
    np.testing.assert_allclose(scaled.logpdf(c * x), law.logpdf(x) - math.log(c), rtol=1e-12)


@pytest.mark.parametrize(
    ("law", "bounds", "expected"),
    [
        (BoundedExponential(3.0), (0.1, 0.4), BoundedExponential(3.0, 0.1, 0.4)),
        (BoundedNormal(2.0, 0.0, 1.0, 0.5), (0.1, 0.4), BoundedNormal(2.0, 0.1, 0.4, 0.5)),
        (Pareto(1.7, 0.1), (0.2, math.inf), Pareto(1.7, 0.2)),
        (
            NORMALS,
            (0.1, 0.4),
            Mixture((0.3, 0.7), (BoundedNormal(0.03, 0.1, 0.4), BoundedNormal(0.09, 0.1, 0.4))),
        ),
        (
            PIECES,
            (0.1, 0.4),
            PiecewiseMixture((0.9, 0.1), (NORMALS.rebounded(0.1, 0.2), BoundedExponential(21.0, 0.2, 0.4))),
        ),
    ],
)
def test_new_bounds_change_nothing_else(law, bounds, expected):
    assert law.rebounded(*bounds) == expected
    assert (expected.lower, expected.upper) == bounds


def test_new_bounds_that_do_not_fit_are_refused():
    with pytest.raises(ValueError, match="no upper bound"):
        Pareto(1.7, 0.1).rebounded(0.1, 1.0)
    with pytest.raises(ValueError, match="bounds must satisfy"):
        PIECES.rebounded(0.3, math.inf)
    with pytest.raises(ValueError, match="zip"):
        PIECES.with_bounds([0.0, 0.1, 0.2, math.inf])


@pytest.mark.parametrize(
    "content", [{"kind": "bounded gamma"}, {"kind": ["mixture"]}, {}, {"kind": "Pareto"}]
)
def test_content_of_no_known_kind_is_refused(content):
    with pytest.raises((KeyError, TypeError, ValueError)):
        from_dict(content)
