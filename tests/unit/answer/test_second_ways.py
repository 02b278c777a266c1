"""The second way to each published number: against closed forms, wrong twins, and the shipped study."""

from functools import partial
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest
from accelerated_evaluation.answer import second_ways as module
from accelerated_evaluation.answer.candidates.fitted_records import FittedRecords
from accelerated_evaluation.answer.second_ways import (
    DOUBTFUL,
    ROWS,
    Plain,
    StudyNumbers,
    WideCutIns,
    map_errors,
    parts_of_map,
    published,
    second_numbers,
    second_ways,
)
from accelerated_evaluation.answer.ways import by_map
from accelerated_evaluation.answer.ways.answer import evaluate
from accelerated_evaluation.crash_map.mapping import map_crashes
from accelerated_evaluation.laws.smooth.family import DistinctRecords
from accelerated_evaluation.methods.problem import Problem
from accelerated_evaluation.publishing.study import TABLES
from accelerated_evaluation.scenarios.cut_in import CUT_IN, Outcomes
from accelerated_evaluation.vehicles.loading import load_vehicle
from accelerated_evaluation.vehicles.protocol import events_of
from builders import coarse_grid
from mean_law import SUPPORT, encounters_, law_  # noqa: F401
from scipy.stats import chi2

RANGE, CAP = 75.0, 45.0
SPEEDS = np.linspace(5, 35, 1001)
MEANS = np.array([1.0, 1.5])  # of the exponential closing speed, one for each law
MAPS = 20  # number of crash maps whose values are compared with the errors that they state
FAR = 4.0  # errors from which on two numbers contradict each other
PUBLISHED = Path(__file__).resolve().parents[3] / "figures" / "spmd" / "tables"
# Tables whose numbers are no probabilities of the answer, and where their second ways are.
RECORDS = "segment_counts dependence similarity calibration fold_calibration far_records margins"
PAPER = "candidates trace course crude convergence variation repeated_searches sensitivity uncertainty"
PAPER += " bootstrap coverage"  # readings, claims, crude Monte Carlo
LAWS = "laws joint_laws choices data_quality answer_thresholds host_limit near_miss_answer extrapolation"
PARTS = "answer_draws vehicle_draws crash_places answer_budget injury_budget injury_curves criteria deciding"
SHOWN = "happened traces preventable prescribed numerical_error second_ways"
FEW_RUNS = "sampled_estimate sampled_runs sampled_crashes scenario_estimates scenario_agreement"
OTHERS = "crash_shares impact_speeds"
WITHOUT = " ".join((RECORDS, PAPER, LAWS, PARTS, SHOWN, FEW_RUNS, OTHERS)).split()


def density(x):
    """The range is uniform, and the closing speed exponential, with the rest of its mass at the cap."""
    closing, rate = x[:, 2], 1 / MEANS[:, None]
    below = np.log(rate) - rate * closing
    return np.where(closing >= CAP, -rate * CAP, below) - np.log(RANGE)


def features(x):
    """Two vehicles: the events of the first one, and those of the second if a fair coin falls on heads.

    The second one has two rows, whose coins are not fair.
    """
    events = ((x[:, 2] > 15) & (x[:, 1] < 10)).astype(float)[:, None]
    yield "car", events, None
    for share in (0.2, 0.8):
        yield "random", events, partial(lambda p, chosen: np.full((MEANS.size, chosen.size), p), share)


@pytest.mark.parametrize("wrong", [1.0, 1.5])
def test_a_rare_event_has_its_probability(monkeypatch, wrong):
    """The second value is that of a density which is half as large again, and has to be found out."""
    monkeypatch.setattr(module, "SIZE", 2**13)
    wide = WideCutIns(SPEEDS, RANGE, CAP)
    plain = Plain.of(wide, lambda x: density(x) + np.log(wrong), features, np.random.default_rng(2))
    found = plain.numbers(
        lambda means: {(name, k): each[k, 0] for name, each in means.items() for k in range(MEANS.size)}
    )
    exact = np.exp(-15 / MEANS) * (10 - module.NEAREST) / RANGE
    for (name, k), (value, error) in found.items():
        right = exact[k] * (0.5 if name == "random" else 1.0)
        assert error < 0.05 * right
        assert (abs(value - right) < FAR * error) == (wrong == 1)


def test_the_wide_density_is_one():
    """The mean of density / density over a box is its volume, also at the cap on the closing speed."""
    wide = WideCutIns(SPEEDS, RANGE, CAP)
    x, log_density = wide.points(np.random.default_rng(3).random((400_000, 5)))
    inside = (x[:, 1] > 20) & (x[:, 2] > 3) & (x[:, 2] < 9)
    for chosen, volume in ((inside, (RANGE - 20) * 6), (x[:, 2] >= CAP, RANGE - module.NEAREST)):
        terms = np.where(chosen, np.exp(-log_density), 0)
        assert abs(terms.mean() - volume) < FAR * terms.std() / np.sqrt(terms.size)


def test_every_table_of_a_study_is_computed_twice_or_says_why_not():
    assert sorted([*ROWS, *WITHOUT]) == sorted(TABLES)


# Lead motion that is known for all cut-ins, and for closing ones only.
KNOWN = {"vehicle": "under test", "gap": ["closing", "opening"], "cut_ins": [0.4, 0.6], "high95": 4e-5}
KNOWN |= {"moving": [1e-4, 3e-5], "standard_error": [1e-6, 5e-6], "factor": [1.5, np.nan]}
KNOWN |= {"factor_error": [0.3, np.nan]}
MOTIONS = [pd.DataFrame(KNOWN), pd.DataFrame(KNOWN | {"moving": [1e-4, np.nan], "factor": [0.9, np.nan]})]


def numbers_of(encounters, law, seed):
    """Return the numbers of a small study of a car and a random driver, by points of their own."""
    exposure = {"kilometres": 1e5, "hours": None}
    records = FittedRecords.of(CUT_IN, encounters, SUPPORT, exposure)
    vehicles = {
        name: load_vehicle(car, CUT_IN) for name, car in (("under test", "acc_only"), ("human", "human"))
    }
    events = [CUT_IN.events[0], *events_of(CUT_IN, {"impact_speed": [5], "min_ttc": [1.5]})]
    generators = (lambda _: np.random.default_rng(4)), np.random.default_rng(seed)
    return StudyNumbers(vehicles, CUT_IN, records, law, events, *generators, law, events, MOTIONS)


def tables_of(found):
    """Return the tables of numbers by table, row and column, as a study writes them."""
    rows: dict[str, dict[str, dict]] = {}
    for (table, row, column), value in found.items():
        names = row.split(", ", len(ROWS[table]) - 1) if len(ROWS[table]) > 1 else [row]
        cells = dict(zip(ROWS[table], names, strict=True))
        rows.setdefault(table, {}).setdefault(row, cells)[column] = value
    return {table: pd.DataFrame(found.values()) for table, found in rows.items()}


def test_only_a_wrong_number_is_far_from_its_second_one(encounters, law, monkeypatch):
    """The first numbers come from twice as many points, and three of them are made wrong."""
    monkeypatch.setattr(module, "SIZE", 2**12)
    found = {key: value for key, (value, _) in second_numbers(numbers_of(encounters, law, 1))[0].items()}
    monkeypatch.setattr(module, "SIZE", 2**11)
    wrong = {"answer": ("TTC at most 1.5 s", "high80"), "injuries": ("under test, MAIS3+, cut-in", "mean")}
    wrong["all_cut_ins"] = ("under test, all, closing cut-in", "low80")
    for table, (row, column) in wrong.items():
        found[table, row, column] *= 1.5
    tables = tables_of(found)
    tables["counted_crashes"]["kind"] = "predicted"
    twice = second_ways(numbers_of(encounters, law, 2), tables)
    assert len(twice) == np.isfinite(list(found.values())).sum()
    assert twice["second"].notna().mean() > 0.8
    far = twice[twice["difference"].abs() > FAR]
    assert {(each.table, (each.row, each.column)) for each in far.itertuples()} == set(wrong.items())


class Late:
    """A driver who stops too late if the time to collision is below a limit of its own."""

    deterministic = False

    def simulate(self, lead_speed, range_, closing_speed):
        return self.simulate_given(lead_speed, range_, closing_speed, np.ones((len(range_), 1)))

    def draw_inner(self, size, generator):
        return np.exp(generator.normal(0, 0.5, (size, 1)))

    def inner_weights(self, inner, draws, generator):
        return np.ones((draws, len(inner)))

    def simulate_given(self, lead_speed, range_, closing_speed, inner):
        crash = closing_speed * inner[:, 0] > range_
        return Outcomes(crash, np.where(crash, 0, range_), np.where(crash, 0.5, 5.0), 1.0 * crash)


@pytest.mark.parametrize("vehicle", [Late(), load_vehicle("acc_only", CUT_IN)])
def test_the_error_of_a_map_is_that_between_maps(encounters, law, monkeypatch, vehicle):
    """The error of the mean of two halves, for the sum of them, would be half as large and is found out."""
    grid = coarse_grid(speeds=(5, 25, 8), ranges=(60, 30), closing=(120, 40), refinement=3)
    records, values, stated = DistinctRecords.of(encounters, SUPPORT), [], []
    problem, risks = Problem(CUT_IN, vehicle, law=law), {"mean": np.minimum(module.SPEEDS / 20, 1)}
    monkeypatch.setattr(by_map, "LINES", 250)

    def made(means):
        return {"mean": means["late"][:, 1].mean(), "high80": np.quantile(means["late"][:, 0], 0.9)}

    for seed in range(MAPS):
        way = by_map.Map(map_crashes(vehicle, grid, [], seed), records)
        parts = parts_of_map(evaluate(problem, law, way, generator=seed).crashes, risks)
        numbers, means = SimpleNamespace(of_maps={"late": parts}, made=made), {"late": parts.mean(axis=0)}
        stated.append([*map_errors(numbers, means).values()])
        values.append([*made(means).values()])
    low, high = chi2(MAPS - 1).ppf([0.001, 0.999])
    squares = (MAPS - 1) * np.var(values, axis=0, ddof=1) / np.mean(np.square(stated), axis=0)
    # Neighbours differ, so that an error may be stated twice as large.
    assert ((low / 4 < squares) & (squares < high)).all()
    assert (4 * squares > high).any()


@pytest.mark.parametrize(("largest", "mechanism"), [(10.0, module.PLAIN), (0.0, module.NONE)])
def test_a_number_without_a_second_way_says_so(encounters, law, monkeypatch, largest, mechanism):
    """A second number whose error is too large counts as none."""
    monkeypatch.setattr(module, "LARGEST", largest)
    monkeypatch.setattr(module, "SIZE", 2**6)
    numbers = numbers_of(encounters, law, 2)
    table = pd.DataFrame({"event": ["crash", "unheard of"], "probability": [1e-3, 1e-3]})
    crash, other = second_ways(numbers, {"answer": table}).itertuples()
    assert (crash.mechanism, other.mechanism) == (mechanism, module.NONE)
    assert np.isnan(other.second)


def test_the_published_numbers_of_the_study_have_a_second_way():
    twice = pd.read_csv(PUBLISHED / "second_ways.csv", keep_default_na=False, na_values=[""])
    tables = {
        name: pd.read_csv(PUBLISHED / f"{name}.csv") for name in ROWS if (PUBLISHED / f"{name}.csv").is_file()
    }
    assert len(tables) >= 6
    rows = set(zip(twice["table"], twice["row"], twice["column"], strict=True))
    assert not published(tables).keys() - rows
    # Chance is a reason up to four errors only.
    assert (twice["reason"].notna() == (twice["difference"].abs() > DOUBTFUL)).all()
