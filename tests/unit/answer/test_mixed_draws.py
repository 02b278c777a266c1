"""Draws that come in parts give a crash map the law of each draw, in the order of the parts."""

from types import SimpleNamespace

import accelerated_evaluation as ae
import numpy as np
import pytest
from accelerated_evaluation.answer.candidates.joint_family import ClusteredRecords
from accelerated_evaluation.answer.ways.by_map import Map
from accelerated_evaluation.base.errors import InputError
from accelerated_evaluation.crash_map.maps import CrashMap
from accelerated_evaluation.laws import LAWS, Box
from accelerated_evaluation.laws.draws import DrawnLaws, OneLaw
from accelerated_evaluation.laws.mixed import MixedLaws
from accelerated_evaluation.laws.protocol import log_slice_of

BOX = Box(("range", "closing_speed"), (0.0, 0.0), (60.0, 40.0))
POINTS = np.array([[10.0, 5.0], [30.0, 20.0], [50.0, 35.0]])


def law(seed):
    generator = np.random.default_rng(seed)
    x = generator.beta(1 + seed, 3, (50, 2)) * BOX.upper
    return LAWS["independent_variables"].fit(x, BOX, generator)


class Smooth(OneLaw):
    """A law with a name as the typical law."""

    @property
    def typical(self):
        return self.name


@pytest.fixture(scope="module")
def mixed():
    laws = [law(seed) for seed in (1, 2, 3)]
    first = DrawnLaws.of(laws[:2], ("one", "two"), np.random.default_rng(3))
    return first + OneLaw(laws[2])


def test_slices_are_those_of_each_draw_and_not_of_the_proposal(mixed):
    low, high = np.full(len(POINTS), 8.0), np.full(len(POINTS), 16.0)
    slices = mixed.log_slices(1, POINTS, low, high)
    expected = [law.log_slice(1, POINTS, low, high) for law in mixed.laws]
    np.testing.assert_array_equal(slices, expected)
    assert len(mixed.laws) == mixed.size == 3
    assert not np.allclose(slices[0], mixed.proposal.log_slice(1, POINTS, low, high), rtol=1e-2)
    only = SimpleNamespace(box=BOX, log_density=mixed.laws[0].log_density)
    by_density = log_slice_of(only, 1, POINTS, low, high)
    np.testing.assert_allclose(np.exp(by_density), np.exp(slices[0]), rtol=1e-3)


def test_the_proposal_is_the_mixture_of_those_of_the_parts_by_their_numbers_of_draws(mixed):
    first, second = (part.proposal for part in mixed.parts)
    x = mixed.draw(20_000, np.random.default_rng(4))
    density = (2 * np.exp(first.log_density(x)) + np.exp(second.log_density(x))) / 3
    np.testing.assert_allclose(mixed.log_density(x), np.log(density), rtol=1e-12)
    ratios = np.exp(mixed.log_ratios(x))  # an estimate of 1 for each draw, if x follows the proposal
    assert (np.abs(ratios.mean(axis=1) - 1) < 5 * ratios.std(axis=1) / np.sqrt(len(x))).all()
    wrong = np.exp(mixed.log_densities(x) - MixedLaws([first, second], np.full(2, 0.5)).log_density(x))
    assert (np.abs(wrong.mean(axis=1) - 1) > 5 * wrong.std(axis=1) / np.sqrt(len(x))).any()


@pytest.mark.parametrize("chosen", [[1, 2], [2], [2, 0, 2, 2, 1]])
def test_a_subset_has_the_chosen_draws_in_their_order(mixed, chosen):
    few = mixed.subset(np.array(chosen))
    assert few.names == tuple(mixed.names[k] for k in chosen)
    np.testing.assert_allclose(few.log_densities(POINTS), mixed.log_densities(POINTS)[chosen], rtol=1e-12)


def test_the_typical_law_is_that_of_the_first_part_that_has_one(mixed):
    assert mixed.typical is None
    smooth = [Smooth(law(1), name) for name in ("first smooth", "second smooth")]
    assert DrawnLaws([*mixed.parts, *smooth]).typical == "first smooth"


def test_a_map_needs_points_of_the_variables_of_cut_ins():
    crash_map = CrashMap.__new__(CrashMap)
    x = np.array([[10.0, 30.0, 2.0], [20.0, 50.0, 1.0]])
    np.testing.assert_array_equal(Map(crash_map, SimpleNamespace(x=x)).records, x)
    for others in (
        ClusteredRecords.of(POINTS, ["a", "b", "b"], BOX),
        x[0],
        "cut_in",
    ):
        with pytest.raises(InputError, match=r"argument records: seen .* expected records of cut-ins"):
            Map(crash_map, others)
    message = (
        "records of the scenario left_turn; expected records of cut-ins, .* Use Scan, Simulations, or FewRuns"
    )
    with pytest.raises(InputError, match=message):
        Map(crash_map, ae.read_records("left_turn"))


def test_a_map_recommends_no_scan_where_there_is_none():
    way = Map(CrashMap.__new__(CrashMap), np.ones((2, 3)))
    with pytest.raises(InputError, match=r"a problem of the scenario pedestrian; .* Use Simulations, or"):
        way.answer(ae.Problem("pedestrian", "acc_aeb"), None, (), None)
