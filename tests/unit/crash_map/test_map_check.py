"""The check of a crash map by independent simulations: right maps pass, wrong ones are replaced."""

import numpy as np
import pandas as pd
import pytest
from accelerated_evaluation import CUT_IN, load_vehicle, map_crashes
from accelerated_evaluation.crash_map.checked import check_map, require_right_map
from accelerated_evaluation.crash_map.exact import exact_probabilities
from accelerated_evaluation.crash_map.intervals import Intervals
from accelerated_evaluation.crash_map.maps import CrashMap
from accelerated_evaluation.publishing.tables.exact import contradictions
from accelerated_evaluation.vehicles import Outcomes
from accelerated_evaluation.vehicles.protocol import CRASH
from builders import coarse_grid
from law_folder import LAW

GRID = coarse_grid(speeds=(5, 15.1, 8), ranges=(75, 12), closing=(23.49, 60))


class Striped:
    """Crashes in every second stripe of the closing speed, where TTC^-1 exceeds a limit."""

    def __init__(self, width=0.5, limit=0.2):
        self.width, self.limit = width, limit

    def simulate(self, lead_speed, range_, closing_speed):
        crash = (closing_speed > self.limit * range_) & (np.floor(closing_speed / self.width) % 2 == 0)
        ttc = np.where(crash, 0.5, 5.0)
        return Outcomes(crash, np.where(crash, 0.0, range_), ttc, np.where(crash, closing_speed, 0.0))


def striped_truth(law, draws=2_000_000):
    """Return the crash probability of `Striped` by crude Monte Carlo, and its standard error."""
    x = law.from_normal_scores(np.random.default_rng(1).standard_normal((draws, 3)))
    crash = Striped().simulate(*x.T).crash
    return crash.mean(), crash.std() / np.sqrt(draws)


@pytest.mark.parametrize("name", ["acc_aeb", "acc_only", "cc_human", "rss", "fsm", "human"])
def test_a_right_map_passes(name):
    vehicle = load_vehicle(name)
    crash_map = map_crashes(vehicle, GRID, [], np.random.default_rng(2))
    assert not check_map(vehicle, crash_map, np.random.default_rng(3)).contradicts
    assert require_right_map(vehicle, crash_map, np.random.default_rng(3)) is crash_map


def test_a_wrong_map_is_found():
    """Intervals that begin 20 % too late are contradicted."""
    vehicle = load_vehicle("acc_only")
    right = map_crashes(vehicle, GRID, [], np.random.default_rng(2))
    crash = right.intervals(CRASH)
    late = Intervals(crash.line, np.minimum(1.2 * crash.start, crash.end), crash.end)
    wrong = CrashMap(right.grid, right.cells, right.lead_speed, right.inverse_range, {CRASH: late})
    assert check_map(vehicle, wrong, np.random.default_rng(3)).contradicts


@pytest.mark.parametrize("width", [0.5, 0.4])
def test_stripes_that_a_coarse_scan_misses_are_found(width, capsys):
    """The map that takes the place of the wrong one has the right probability, within its standard error."""
    vehicle = Striped(width)
    impact = CUT_IN.event("impact_speed", 5.0)
    crash_map = map_crashes(vehicle, GRID, [impact], np.random.default_rng(2))
    replaced = require_right_map(vehicle, crash_map, np.random.default_rng(3))
    assert replaced is not crash_map
    assert "contradicted by simulations at random closing speeds" in capsys.readouterr().err
    assert set(replaced.events) == {CRASH, impact}


def test_the_replaced_map_is_unbiased():
    vehicle = Striped()
    crash_map = map_crashes(vehicle, GRID, [], np.random.default_rng(2))
    truth, error = striped_truth(LAW)
    replaced = exact_probabilities(require_right_map(vehicle, crash_map, np.random.default_rng(3)), LAW)[
        "all"
    ]
    assert abs(replaced.probability - truth) < 4 * np.hypot(error, replaced.standard_error) + 0.01 * truth
    scanned = exact_probabilities(crash_map, LAW)["all"]
    assert abs(scanned.probability - truth) > 4 * np.hypot(error, scanned.standard_error)


@pytest.mark.parametrize(("crashes", "contradicted"), [(100, False), (120, False), (190, True), (40, True)])
def test_crude_monte_carlo_may_contradict_the_map(crashes, contradicted):
    truth = pd.Series({"probability": 1e-4, "standard_error": 1e-6})
    crude = pd.DataFrame({"segment": ["all"], "simulations": [1_000_000], "crashes": [crashes]})
    told = contradictions(truth, crude)
    assert bool(told) == contradicted
    assert not contradicted or f"{crashes} crashes in 1,000,000 simulations, where 100.0 are expected" in told
