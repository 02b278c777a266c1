"""A campaign within what a proving ground can drive: exact within, and what lies beyond is told."""

from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from accelerated_evaluation import CUT_IN, Problem, Stopping, child_generator, cli, load_vehicle, read_law
from accelerated_evaluation.methods import METHODS
from accelerated_evaluation.records.segments import read_encounters
from accelerated_evaluation.track.campaign import Campaign
from accelerated_evaluation.track.campaign_file import read_campaign
from accelerated_evaluation.track.limits import UNLIMITED, Limits
from accelerated_evaluation.track.results import status_of
from accelerated_evaluation.vehicles import Outcomes
from dependent_law import dependent_law
from law_folder import LAW, SPEEDS, begin_campaign

LIMITS = Limits(host_speed_max=32.0, closing_speed_max=23.0, range_min=3.0)
OPTIONS = ("--host-speed-max", 32, "--closing-speed-max", 23, "--range-min", 3)
GOAL = Stopping(alpha=0.2, beta=0.5, minimum_events=1)
DRAWS = 200_000


class Within:
    """The study's car; beyond the limits nothing happens."""

    deterministic = True

    def __init__(self):
        self.car = load_vehicle("acc_aeb")

    def simulate(self, lead_speed, range_, closing_speed):
        driven = CUT_IN.settable(np.array([lead_speed, range_, closing_speed]).T).T
        found, within = self.car.simulate(*driven), LIMITS.hold(*driven)
        return Outcomes(
            found.crash & within,
            np.where(within, found.min_range, np.inf),
            np.where(within, found.min_ttc, np.inf),
            np.where(within, found.impact_speed, 0.0),
        )


@pytest.fixture
def campaign(tmp_path, monkeypatch):
    """A campaign with limits in the current folder, and a function that runs one step of it."""
    monkeypatch.chdir(tmp_path)
    return begin_campaign(tmp_path, "--batch-size", 20, *OPTIONS)


@pytest.fixture(scope="module", params=[LAW, dependent_law(), dependent_law(cap=12.0)], ids="abc")
def drawn(request):
    """A law, and cut-ins that are drawn from it."""
    return request.param, request.param.draw(DRAWS, np.random.default_rng(5)).T


def exact(*limits):
    """P(crash within each of some limits) under LAW to 5 percent; TTC^-1 is drawn from a wider law."""
    generator, size = np.random.default_rng(1), 200_000
    lead_speed, inverse_range = generator.choice(SPEEDS, size), LAW.inverse_range.rvs(generator, size)
    inverse_ttc = generator.exponential(1 / 5, size)
    weight = 15 / 5 * np.exp(-(15 - 5) * inverse_ttc)
    cut_ins = lead_speed, 1 / inverse_range, LAW.capped(inverse_ttc / inverse_range)
    crashes = weight * load_vehicle("acc_aeb").simulate(*cut_ins).crash
    return [np.mean(crashes * each.hold(*cut_ins)) for each in limits]


def test_a_campaign_within_limits_drives_nothing_beyond_and_finds_the_event_within(campaign, capsys):
    driven = []
    while not status_of(read_campaign("c.json")).may_stop:
        assert campaign("ask", "next", "--no-scenarios") == 0
        assert cli.main(["simulate", "next/runs.csv", "done.csv"]) == 0
        driven.append(pd.read_csv("done.csv"))
        assert campaign("tell", "done.csv") == 0
    runs = pd.concat(driven)
    assert LIMITS.hold(runs["lead_speed"], runs["range"], runs["closing_speed"]).all()
    status = status_of(read_campaign("c.json"))
    assert status.asked == status.reported == status.used == len(runs)
    assert status.spared == len(read_campaign("c.json").runs) - len(runs) > 0
    # Told of what lies beyond, the sampler itself comes to the same.
    wanted = METHODS["surrogate"](batch_size=20).estimate(
        Problem(CUT_IN, Within(), law=LAW), GOAL, child_generator(4, "campaign")
    )
    assert status.estimate.row() == wanted.row()
    error = (status.estimate.high - status.estimate.low) / 2 / 1.28
    within, anywhere = exact(LIMITS, UNLIMITED)
    assert abs(status.estimate.probability - within) < 4 * error
    assert abs(status.estimate.probability - anywhere) > 4 * error  # the wrong variant
    assert anywhere < status.estimate.high + read_campaign("c.json").beyond
    capsys.readouterr()
    campaign("status")
    told = capsys.readouterr().out
    assert f"runs beyond, not to be driven: {status.spared}\n" in told
    assert f"beyond      {read_campaign('c.json').beyond:.2g} of all cut-ins" in told


@pytest.mark.parametrize(
    "limits",
    [LIMITS, Limits(host_speed_max=24.0), Limits(closing_speed_max=13.0), Limits(range_min=5.0), UNLIMITED],
)
def test_what_lies_beyond_is_an_exact_integral(drawn, limits):
    law, cut_ins = drawn
    wanted = 1 - limits.hold(*cut_ins).mean()
    error = np.sqrt(wanted * (1 - wanted) / DRAWS)
    assert limits.beyond(law) == pytest.approx(wanted, abs=4 * error + 5 / DRAWS)


def test_a_probability_beyond_that_no_draw_reaches():
    speed = SPEEDS.mean()
    limits = Limits(closing_speed_max=20.0)
    u = (np.arange(200_000) + 0.5) / 200_000
    inverse_range = LAW.strata["5-15"].factors.first.isf(u)
    closing = np.full(u.size, 20.0)
    beyond = LAW.strata["5-15"].closing_speed_probability(
        np.full(u.size, speed), inverse_range, closing, closing + np.inf
    )
    assert limits.beyond(LAW) == pytest.approx(beyond.mean(), rel=1e-4)
    assert Limits(closing_speed_max=LAW.closing_speed_max).beyond(LAW) == 0


def test_a_run_beyond_the_limits_cannot_be_told(campaign, capsys):
    campaign("ask", "next", "--no-scenarios")
    beyond = next(run.number for run in read_campaign("c.json").runs if run.outcome is not None)
    Path("told.csv").write_text(f"run,crash\n{beyond},1\n")
    assert campaign("tell", "told.csv") == 2
    assert f"seen run {beyond}, which is beyond the limits" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (("--range-min", "-1"), "--range-min: seen -1; expected a number above 0"),
        (("--host-speed-max", "inf"), "--host-speed-max: seen inf"),
        (("--host-speed-max", "6"), "expected a share of at most 0.5 beyond"),
    ],
)
def test_limits_that_cannot_be_used(campaign, capsys, options, message):
    law = ["--law", "law.json", "--encounters", "encounters.parquet"]
    assert cli.main(["campaign", "new", "other.json", *law, *options]) == 2
    assert message in capsys.readouterr().err
    assert not Path("other.json").exists()


def test_limits_within_which_nothing_is_found_end_in_a_message(campaign, monkeypatch):
    begun = read_campaign("c.json")
    begun.limits = Limits(range_min=1e6)
    with pytest.raises(Exception, match="no run within range at least 1e"):
        begun.ask(read_law("law.json", read_encounters("encounters.parquet")))
    assert isinstance(begun, Campaign)
