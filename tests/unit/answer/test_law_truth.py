"""Scores, weights, calibration and exact probabilities of laws with dependence, against closed forms."""

from dataclasses import replace
from functools import partial
from types import SimpleNamespace

import accelerated_evaluation as ae
import numpy as np
import pandas as pd
import pytest
from accelerated_evaluation.answer.candidates.calibration import (
    counts_by_fold,
    expected_counts,
    fold_row,
    mid_p,
    near_miss_counts,
    recorded_by_fold,
    recorded_counts,
    strips,
    with_poisson_limits,
)
from accelerated_evaluation.answer.candidates.law_weights import bootstrapped_weights
from accelerated_evaluation.answer.candidates.scores import (
    Fold,
    HeldOut,
    censored_log_score,
    contiguous_blocks,
    contiguous_folds,
    forward_folds,
)
from accelerated_evaluation.answer.candidates.smooth_family import SmoothFamily
from accelerated_evaluation.answer.ways import choices
from accelerated_evaluation.answer.ways.by_map import MapCrashes, thinned_lines
from accelerated_evaluation.answer.ways.choices import choice_table
from accelerated_evaluation.answer.ways.comparison import is_resolved, vehicle_row, vehicle_table
from accelerated_evaluation.answer.ways.posterior import budget
from accelerated_evaluation.answer.ways.variants import quality_table
from accelerated_evaluation.crash_map.exact import ALL, exact_probabilities
from accelerated_evaluation.crash_map.lines import CrashLines, crash_places
from accelerated_evaluation.laws.paper.models import recorded_lead_speeds
from accelerated_evaluation.laws.smooth.conditional import Places
from accelerated_evaluation.laws.smooth.draws import SmoothDraws
from accelerated_evaluation.laws.smooth.family import Fitter, Member, members_at
from accelerated_evaluation.laws.smooth.independent import IndependentTail
from accelerated_evaluation.laws.smooth.mean import MeanLaw
from accelerated_evaluation.laws.smooth.support import SUPPORT
from accelerated_evaluation.laws.strata import VARIABLES
from accelerated_evaluation.records.segments import complete
from accelerated_evaluation.vehicles.protocol import CRASH
from builders import coarse_grid
from rate_car import RATE, RateCar, exponential_records
from scipy.stats import kstest, poisson

SIZE = 12_000
MEAN = 2.0  # [m/s], of the closing speeds that the tests draw
MEMBERS = members_at((0.9,))


class ExponentialSpeeds:
    """Closing speeds that are exponential everywhere."""

    def __init__(self, mean=MEAN):
        self.mean = mean

    def given(self, places):
        return self

    def cumulative(self, closing_speed):
        return closing_speed / self.mean

    def log_density(self, closing_speed):
        return -closing_speed / self.mean - np.log(self.mean)


@pytest.fixture(scope="module")
def records():
    return exponential_records(SIZE, MEAN)


@pytest.fixture(scope="module")
def fitter(records):
    return Fitter(records, MEMBERS)


@pytest.fixture(scope="module")
def family(fitter):
    return fitter.fit()


@pytest.fixture(scope="module")
def crash_map():
    return ae.map_crashes(
        RateCar(),
        coarse_grid(),
        [],
        np.random.default_rng(2),
    )


def crash_probability(mean=MEAN):
    """P(C > RATE R) for exponential C and P(R < r) = (r / 75)^2, in closed form."""
    decay = RATE * SUPPORT.range_max / mean
    return 2 * (1 - np.exp(-decay) * (1 + decay)) / decay**2


def test_blocks_are_contiguous_and_of_like_size():
    blocks = contiguous_blocks(103, 10)
    assert np.all(np.diff(blocks) >= 0)
    assert set(np.bincount(blocks)) == {10, 11}


def test_a_censored_score_is_a_density_inside_and_a_probability_outside():
    law, boundary = ExponentialSpeeds(), np.array([3.0, 3.0, 0.0])
    score = censored_log_score(law, np.array([4.0, 1.0, 1.0]), boundary)
    truth = [-4 / MEAN - np.log(MEAN), np.log(1 - np.exp(-3 / MEAN)), -1 / MEAN - np.log(MEAN)]
    np.testing.assert_allclose(score, truth, rtol=1e-12)


def test_the_true_law_has_the_best_censored_score_and_the_uncensored_one_would_tell_the_bulk():
    generator = np.random.default_rng(3)
    speeds = MEAN * generator.standard_exponential(40_000)
    boundary = np.full(speeds.size, 6.0)
    right, wrong = (
        censored_log_score(ExponentialSpeeds(mean), speeds, boundary).sum() for mean in (MEAN, 1.9)
    )
    assert right > wrong
    # A law that is wrong below the boundary alone loses nothing.
    speeds[speeds < 6] = 1.0
    assert censored_log_score(ExponentialSpeeds(), speeds, boundary).sum() == pytest.approx(right, rel=1e-12)


def test_held_out_scores_know_nothing_of_the_block(records):
    seen = []
    fit = lambda part: seen.append(part.closing_speed) or ExponentialSpeeds()  # noqa: E731
    HeldOut.of_law(fit, records, contiguous_folds(SIZE, 4))
    assert [len(known) for known in seen] == [SIZE - SIZE // 4] * 4
    seen.clear()
    held_out = HeldOut.of_law(fit, records, forward_folds(SIZE, 4))
    halves = [fold.tested[0] for fold in held_out.folds]
    assert halves == [SIZE // 2, SIZE // 4 * 3]
    for known, start in zip(seen, halves, strict=True):  # forward in time, only the records before
        np.testing.assert_array_equal(known, records.closing_speed[:start])


def test_members_score_like_the_true_law_where_there_are_records(records, fitter, family):
    regions = {"upper": np.full(SIZE, 5.0)}
    held_out = HeldOut.of_family(fitter, family, contiguous_folds(SIZE, 5))
    scores = held_out.scores(regions)["upper"]
    truth = censored_log_score(ExponentialSpeeds(), records.closing_speed, regions["upper"])
    # Each fitted parameter costs about half a nat held out; the splines of the tail use some tens.
    assert np.all(scores.sum(axis=1) > truth.sum() - 40)


def test_equal_laws_share_the_weight_and_a_refused_one_gets_none():
    generator = np.random.default_rng(4)
    score, inside = generator.normal(-3, 1, 500), np.ones(500, dtype=bool)
    scores = np.array([score, score, score - 0.2])
    scores[2, 7] = -np.inf
    weights = bootstrapped_weights(scores, inside, 200, generator)
    np.testing.assert_allclose(weights.sum(axis=1), 1, rtol=1e-12)
    np.testing.assert_allclose(weights[:, :2], 0.5, atol=1e-9)


def test_poisson_limits_and_mid_p_values():
    table = with_poisson_limits(
        pd.DataFrame({"where": ["a", "b"], "recorded": [3, 12], "expected": [3.0, 4.0]})
    )
    assert table["low"].tolist() == [poisson.ppf(0.05, 3), poisson.ppf(0.05, 4)]
    assert table["within"].tolist() == [True, False]
    assert mid_p(0, 1.0) == pytest.approx(2 * np.exp(-1) / 2)
    # Mid-p values of Poisson counts are uniform but for their steps: their mean is a half.
    counts = np.arange(60)
    assert np.sum(poisson.pmf(counts, 9.0) * mid_p(counts, 9.0)) == pytest.approx(0.5, abs=0.03)


def test_cells_count_what_is_recorded_and_expect_it_from_the_true_law(records):
    def judged(law: ExponentialSpeeds) -> pd.DataFrame:
        (expected,) = expected_counts(records, lambda places: [law])
        return with_poisson_limits(recorded_counts(records).assign(expected=expected))

    counts = judged(ExponentialSpeeds())
    assert len(counts) == sum(len(strip.names) for strip in strips()) == 64
    inside = (records.range_ < 5) & (records.closing_speed >= 1) & (records.closing_speed < 2)
    assert counts["recorded"].iloc[0] == inside.sum()
    assert counts["p_value"].min() > 0.05 / len(counts)
    wrong = judged(ExponentialSpeeds(1.5 * MEAN))
    assert wrong["p_value"].min() < 1e-4


CELL_MEANS = np.geomspace(0.02, 300, 64)  # expected numbers of cells, as wide as those of the study


def fold_rows(counts):
    """Return the rows of 400 tables, each of counts of two halves under the cell means."""
    expected = np.tile(CELL_MEANS, (2, 1))
    return pd.DataFrame([fold_row(own, expected) for own in counts])


def test_poisson_counts_are_outside_their_limits_as_often_as_expected_by_chance():
    generator = np.random.default_rng(9)
    rows = fold_rows(generator.poisson(CELL_MEANS, (400, 2, CELL_MEANS.size)))
    assert set(rows["cells"]) == {128}
    # Less than 10 % of the cells, because counts are whole numbers.
    error = rows["outside"].std() / np.sqrt(len(rows))
    assert rows["outside"].mean() == pytest.approx(rows["by_chance"][0], abs=4.5 * error)
    assert 0.02 * 128 < rows["by_chance"][0] < 0.1 * 128
    error = rows["dispersion"].std() / np.sqrt(len(rows))
    assert rows["dispersion"].mean() == pytest.approx(1, abs=4.5 * error)
    assert 0.02 < rows["overdispersed"].mean() < 0.1  # of the nominal 5 %, by a normal approximation


def test_overdispersed_counts_of_halves_are_flagged_although_their_sums_agree():
    """The rate is half as large in one half of the records and larger in the other, so that the sum is right.

    Summed over the folds, as the check was once made, the counts look like those of the law.
    """
    generator = np.random.default_rng(10)
    drifting = np.array([0.75, 1.25])[:, None] * CELL_MEANS
    counts = generator.poisson(drifting, (400, *drifting.shape))
    rows = fold_rows(counts)
    assert rows["overdispersed"].mean() > 0.95
    assert rows["outside"].mean() > 2 * rows["by_chance"][0]
    sums = pd.DataFrame([fold_row(own.sum(axis=0), 2 * CELL_MEANS) for own in counts])
    assert sums["overdispersed"].mean() < 0.1
    assert sums["dispersion"].mean() == pytest.approx(1, abs=0.1)


def test_expected_numbers_of_folds_are_those_of_laws_that_do_not_know_them(records):
    """The law of a fold has the mean of the known closing speeds; one that knows all would miss the drift."""
    drifting = replace(records, closing_speed=records.closing_speed * np.linspace(0.8, 1.2, SIZE))
    fit = lambda part: ExponentialSpeeds(part.closing_speed.mean())  # noqa: E731
    folds = contiguous_folds(SIZE, 2)
    recorded = recorded_by_fold(drifting, folds)
    assert recorded.sum(axis=0).tolist() == recorded_counts(drifting)["recorded"].tolist()
    held_out = counts_by_fold(HeldOut.of_law(fit, drifting, folds))[0]
    assert held_out.shape == recorded.shape == (2, 64)
    assert fold_row(recorded, held_out)["overdispersed"]
    known = counts_by_fold(HeldOut.of_law(fit, drifting, [Fold(f.tested, f.tested[:0]) for f in folds]))[0]
    assert fold_row(recorded, held_out)["dispersion"] > 1.5 * fold_row(recorded, known)["dispersion"]
    steady = counts_by_fold(HeldOut.of_law(fit, records, folds))[0]
    assert not fold_row(recorded_by_fold(records, folds), steady)["overdispersed"]


def test_near_misses_are_expected_in_proportion():
    counts = near_miss_counts({"near": 4}, {"near": 1e-3}, 5000)
    assert counts.iloc[0].tolist() == ["near", "replay", 4, 5.0]


def test_exact_probability_of_a_smooth_law(crash_map, records, family):
    lines = CrashLines.of(crash_map, records.lead_speed)
    truth = crash_probability()
    law = family.law(Member())
    masses = lines.masses(SmoothDraws.of_laws(family.ranges, [law]))[0]
    found = masses.sum()
    # 12,000 records hold some 190 crashes of this kind: 7 % by chance alone, and as much by smoothing.
    assert found == pytest.approx(truth, rel=0.25)
    assert found != pytest.approx(crash_probability(1.5 * MEAN), rel=0.25)
    _, range_, speed = crash_places(lines, masses, law, 3000, np.random.default_rng(6))
    assert np.all(speed > RATE * range_ * 0.98)


class ExponentialDensity:
    """Cut-ins with exponential closing speeds, given by their density alone."""

    box = SimpleNamespace(upper=(35.0, 75.0, 45.0))

    def log_density(self, x):
        return -x[:, 2] / MEAN


def test_crashes_of_a_map_are_drawn_where_they_happen_and_not_in_the_middle_of_its_intervals(
    crash_map, records, fitter, family, encounters
):
    """The toy car crashes above a closing speed, and exponential speeds exceed it by exponential excesses."""
    draws = equal_weights(fitter, family, encounters).draws(np.random.default_rng(8))
    problem, generator = ae.Problem(ae.CUT_IN, RateCar(), law=draws.proposal), np.random.default_rng(9)
    crashes = ae.evaluate(problem, draws, ae.Map(crash_map, records), generator=generator).crashes

    def distance(x):
        return kstest(x[:, 2] - RATE * x[:, 1], "expon", args=(0, MEAN)).statistic

    drawn = crashes.drawn(2000, generator)
    # The laws are fitted to 12,000 records, and the map knows the boundary to a third of a metre a second.
    assert distance(drawn) < 0.12
    assert len(np.unique(drawn[:, 2])) == 2000
    assert distance(super(MapCrashes, crashes).drawn(2000, generator)) > 0.13  # as it was: the middles
    lines = CrashLines.of(crash_map, records.lead_speed)
    masses = lines.masses(SmoothDraws.of_laws(family.ranges, [family.law(Member())]))[0]
    by_density = crash_places(lines, masses, ExponentialDensity(), 2000, generator)
    assert distance(np.column_stack(by_density)) < 0.12


def test_members_and_parts_of_intervals_give_the_same_probabilities(crash_map, records, family):
    lines, members = CrashLines.of(crash_map, records.lead_speed), MEMBERS[:9]
    laws = [family.law(member) for member in members]
    whole = [lines.masses(SmoothDraws.of_laws(family.ranges, [law]))[0] for law in laws]
    at_once = lines.masses(SmoothDraws.of_laws(family.ranges, laws))
    np.testing.assert_allclose(at_once, whole, rtol=1e-9)
    middle = np.where(np.isfinite(lines.end), (lines.start + lines.end) / 2, lines.start + 1)
    parts = replace(
        lines,
        row=np.repeat(lines.row, 2),
        start=np.column_stack([lines.start, middle]).ravel(),
        end=np.column_stack([middle, lines.end]).ravel(),
    )
    halves = parts.masses(SmoothDraws.of_laws(family.ranges, laws[1:2])).reshape(-1, 2)
    np.testing.assert_allclose(halves.sum(axis=1), whole[1], rtol=1e-9, atol=1e-15)


@pytest.mark.parametrize("by_interval", [False, True])
def test_thinned_lines_are_unbiased(crash_map, records, family, by_interval):
    lines, generator = CrashLines.of(crash_map, records.lead_speed), np.random.default_rng(7)
    laws = SmoothDraws.of_laws(family.ranges, [family.law(Member()), family.law(MEMBERS[1])])
    mass, other = lines.masses(laws)
    whole = other.sum()
    mass = mass if by_interval else np.bincount(lines.row, mass)
    thinned = lines.thinned_intervals if by_interval else lines.thinned
    found = [thinned(mass, 60, generator) for _ in range(60)]
    drawn = [each.masses(laws)[1].sum() for each in found]
    assert abs(np.mean(drawn) - whole) < 4 * np.std(drawn) / np.sqrt(60) + 1e-4 * whole
    # Wrong: the kept lines without the probabilities with which they were kept.
    alike = [replace(each, weight=np.full(each.weight.size, lines.weight.mean())) for each in found]
    wrong = [each.masses(laws)[1].sum() for each in alike]
    assert abs(np.mean(wrong) - whole) > 4 * np.std(wrong) / np.sqrt(60)


def equal_weights(fitter, family, encounters=None):
    """Return a study with 80 draws, in which all members have the same weight."""
    smooth = SmoothFamily(fitter, family, np.zeros((len(MEMBERS), SIZE)), {}, encounters, 45.0)
    return ae.LawStudy(smooth, np.full((80, len(MEMBERS)), 1 / len(MEMBERS)))


def test_the_answer_and_its_variants_print_one_number(
    crash_map, records, fitter, family, encounters, monkeypatch
):
    """The first rows of the variants are the answer itself: the same fit, draws and lines of the map."""
    study, streams = equal_weights(fitter, family, encounters), partial(ae.child_generator, 1)
    draws, car = study.draws(streams("draws")), RateCar()
    problem, way = ae.Problem(ae.CUT_IN, car, law=draws.proposal), ae.Map(crash_map, records)
    answer = ae.evaluate(problem, draws, way, generator=streams("answer")).table().iloc[0]
    lines = thinned_lines(CrashLines.of(crash_map, records.lead_speed), car, draws, streams("answer"))
    monkeypatch.setattr(choices, "SPLINES", {})  # whose fits take a while
    fewer = records.only(np.arange(1, SIZE))
    readings = {"as in the answer": records, "without a record": fewer}
    tables = choice_table(study, lines, streams), quality_table(readings, study, lines, streams)
    for table in tables:
        for column in ("probability", "median", "low80", "high95"):
            assert table[column][0] == pytest.approx(answer[column], rel=1e-9)
        others = table[table.iloc[:, 0] != "equal weights"].iloc[1:]  # the weights of this study are equal
        assert (abs(others["probability"] / answer["probability"] - 1) > 1e-6).all()


def test_the_posterior_holds_the_truth_and_its_budget_adds_up(crash_map, records, fitter, family):
    lines = CrashLines.of(crash_map, records.lead_speed)
    study = equal_weights(fitter, family)
    draws = study.draws(np.random.default_rng(8))
    posterior = ae.Posterior(lines.masses(draws).sum(axis=1), draws.member)
    low, high = posterior.interval(0.95)
    assert low < crash_probability() < high
    parts = budget(posterior, 0.1).set_index("source")
    assert parts["variance_share"].drop("together").sum() == pytest.approx(1)
    assert parts.loc["sampling", "factor"] == pytest.approx(np.exp(np.sqrt(np.log(1.01))))


def test_the_far_tail_has_its_own_share_of_a_budget():
    """The logarithm is the sum of independent parts, of which one is 0 in the fixed draws."""
    generator = np.random.default_rng(4)
    own, far = 0.3 * generator.standard_normal(4000), 0.4 * generator.standard_normal(4000)
    member = np.zeros(4000, dtype=int)
    whole, fixed = (ae.Posterior(1e-6 * np.exp(logs), member) for logs in (own + far, own))
    parts = budget(whole, np.sqrt(np.expm1(0.5**2)), {"far tail": fixed}).set_index("source")
    assert parts.index.tolist() == ["data", "far tail", "choice of law", "sampling", "together"]
    error = 4.5 * np.sqrt(2 / 4000)
    variances = {"data": 0.09, "far tail": 0.16, "sampling": 0.25}
    for source, variance in variances.items():
        share = parts.loc[source, "variance_share"]
        assert share == pytest.approx(variance / 0.5, abs=error)
    without = budget(whole, np.sqrt(np.expm1(0.5**2))).set_index("source")["variance_share"]
    assert without["data"] == pytest.approx(parts["variance_share"][["data", "far tail"]].sum())


def test_draws_with_a_fixed_far_tail_differ_by_it_alone(crash_map, records, fitter, family, encounters):
    study = equal_weights(fitter, family, encounters)
    draws = study.draws(np.random.default_rng(8))
    fixed = draws.fixed()["far tail"]
    assert fixed.names == draws.names
    assert not fixed.fixed()
    places, slow = records.only(np.arange(20)).places, np.full(20, 1.0)
    for one, other in zip(draws.draws.laws[:5], fixed.draws.laws[:5], strict=True):
        # The closing speed of 1 m/s is far below the levels of the far tail, and that of 40 m/s far above.
        np.testing.assert_allclose(*(law.given(places).cumulative(slow) for law in (one, other)), rtol=1e-12)
        fast = [law.given(places).cumulative(40 * slow) for law in (one, other)]
        assert not np.allclose(*fast, rtol=1e-3)
    answer = ae.evaluate(
        ae.Problem(ae.CUT_IN, RateCar(), law=draws.proposal),
        draws,
        ae.Map(crash_map, records),
        generator=np.random.default_rng(9),
    )
    shares = answer.budget(0.1).set_index("source")["variance_share"]
    assert 0 <= shares["far tail"] < 1
    assert shares.drop("together").sum() == pytest.approx(1)


def test_a_budget_without_data_error_blames_the_choice():
    draws = ae.Posterior(np.repeat([1e-6, 4e-6], 50), np.repeat([0, 1], 50))
    parts = budget(draws, 1e-9).set_index("source")["variance_share"]
    assert parts["choice of law"] == pytest.approx(1)


@pytest.fixture(scope="module")
def encounters(records):
    segment = np.array(["5-15", "15-25", "25-35"])[np.digitize(records.lead_speed, [15, 25])]
    numbers = records.lead_speed, records.range_, records.closing_speed
    return complete(pd.DataFrame(dict(zip(VARIABLES, numbers, strict=True)))).assign(segment=segment)


@pytest.fixture(scope="module")
def law(encounters, family):
    counts = {name: int((encounters["segment"] == name).sum()) for name in ("5-15", "15-25", "25-35")}
    alone = SmoothDraws.of_laws(family.ranges, [family.law(Member(0.9, "two kinds"))])
    return MeanLaw("toy", counts, alone, recorded_lead_speeds(encounters, counts))


def test_coordinates_of_a_law_alone_are_scores(law):
    x, stratum = law.draw(4000, np.random.default_rng(9)), law.strata["5-15"]
    lead_speed, range_, closing_speed = x.T
    first = stratum.first(lead_speed, 1 / range_)
    second = stratum.second(lead_speed, 1 / range_, closing_speed)
    for score in (first, second):  # unit exponential, to four standard errors
        assert abs(score.mean() - 1) < 4 / np.sqrt(4000)
    assert abs(np.corrcoef(first, second)[0, 1]) < 4 / np.sqrt(4000)
    np.testing.assert_allclose(stratum.points(lead_speed, first, second), x, rtol=1e-8)


def test_the_map_weighs_a_law_alone_as_lines_do(law, crash_map, encounters, family):
    lines = CrashLines.of(crash_map, encounters["lead_speed"].to_numpy())
    exact = exact_probabilities(crash_map, law)[ALL]
    # The one takes the probability of a cell, and the other one the density on its lines.
    for draws in (ae.OneLaw(law), law):
        assert lines.masses(draws).sum() == pytest.approx(exact.probability, rel=0.02)


def test_an_independent_tail_is_one_distribution(records):
    law = IndependentTail.fit(records, 0.95)
    places = Places.of(np.array([8.0, 30.0]), np.array([30.0, 60.0]))
    given = law.given(places)
    for speed in (np.array([1.0, 1.0]), np.array([40.0, 60.0])):
        slope = (given.cumulative(speed + 1e-5) - given.cumulative(speed - 1e-5)) / 2e-5
        np.testing.assert_allclose(
            np.exp(given.log_density(speed) + given.cumulative(speed)), slope, rtol=1e-3
        )


def test_a_map_that_misses_crashes_of_the_records_is_refused():
    draws = ae.Posterior(np.array([1e-5, 2e-5]), np.zeros(2, dtype=int))
    rare = ae.Posterior(np.array([1e-6, 4e-6]), np.zeros(2, dtype=int))
    posteriors, rows = {"tested": rare, "stripes": draws, "human": draws}, []
    for name, recorded in {"tested": 0, "stripes": 40, "human": 2}.items():
        replayed = ae.Replayed(np.arange(100_000) < recorded)
        own = ae.Answer(SimpleNamespace(event=CRASH), None, {CRASH: posteriors[name]}, replayed=replayed)
        rows.append(vehicle_row(name, own))
        posteriors[name] = own.posterior if is_resolved(own) else None
    table = vehicle_table(pd.DataFrame(rows), posteriors, {"": "human", "other_": "none"})
    table = table.set_index("vehicle")
    assert table["resolved"].to_dict() == {"tested": True, "stripes": False, "human": True}
    assert np.isnan(table.loc["stripes", "probability"])
    assert np.isnan(table.loc["stripes", "ratio"])
    assert table.loc["tested", "ratio"] == pytest.approx(0.15)
    assert table.loc["tested", "safer"] == 1
    assert table.loc["human", "ratio"] == 1
    assert table["other_safer"].isna().all()  # of a reference that is not among the vehicles


def test_a_vehicle_that_never_crashes_has_no_places():
    assert Places.of(np.array([]), np.array([])).splines.shape[0] == 0
