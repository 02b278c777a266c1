"""Draws that come in parts give a crash map the law of each draw, in the order of the parts."""

from types import SimpleNamespace

import numpy as np
import pytest
from accelerated_evaluation.answer.by_map import Map
from accelerated_evaluation.answer.joint_family import ClusteredRecords
from accelerated_evaluation.base.errors import InputError
from accelerated_evaluation.crash_map.maps import CrashMap
from accelerated_evaluation.laws import LAWS, Box
from accelerated_evaluation.laws.draws import DrawnLaws, MixedDraws, OneLaw

BOX = Box(("range", "closing_speed"), (0.0, 0.0), (60.0, 40.0))
POINTS = np.array([[10.0, 5.0], [30.0, 20.0], [50.0, 35.0]])


def law(seed):
    generator = np.random.default_rng(seed)
    x = generator.beta(1 + seed, 3, (50, 2)) * BOX.upper
    return LAWS["independent_variables"].fit(x, BOX, generator)


class Points:
    """Three points in place of the intervals of a crash map; the mass of a point is its density."""

    def of_draw(self, k):
        return self

    def masses_by_density(self, law):
        return np.exp(law.log_density(POINTS))


@pytest.fixture(scope="module")
def mixed():
    laws = [law(seed) for seed in (1, 2, 3)]
    first = DrawnLaws.of(laws[:2], ("one", "two"), np.random.default_rng(3))
    return MixedDraws([first, OneLaw(laws[2])])


def test_the_masses_are_those_of_each_draw_and_not_of_the_proposal(mixed):
    masses = mixed.masses(Points())
    np.testing.assert_allclose(masses, np.exp(mixed.log_densities(POINTS)), rtol=1e-12)
    assert len(mixed.laws) == mixed.size == 3
    assert not np.allclose(masses[0], Points().masses_by_density(mixed.proposal), rtol=1e-2)


def test_the_typical_law_is_that_of_the_first_part_that_has_one(mixed):
    assert mixed.typical is None
    smooth = [SimpleNamespace(typical=name) for name in ("first smooth", "second smooth")]
    assert MixedDraws([*mixed.parts, *smooth]).typical == "first smooth"


def test_a_map_needs_records_with_the_limits_of_smooth_laws():
    records = ClusteredRecords.of(POINTS, ["a", "b", "b"], BOX)
    with pytest.raises(InputError, match="expected records of cut-ins"):
        Map(CrashMap.__new__(CrashMap), records)
