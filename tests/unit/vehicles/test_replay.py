"""Traces of single encounters: they end in the outcomes of `simulate`, and the command writes them."""

import numpy as np
import pandas as pd
import pytest
from accelerated_evaluation import cli, load_vehicle
from accelerated_evaluation.scenarios.cut_in import CUT_IN
from accelerated_evaluation.vehicles.builtin.traces import COLUMNS
from accelerated_evaluation.vehicles.lead_motion import lead_speeds_of
from accelerated_evaluation.vehicles.replay import trace_encounter

WIDTH = 1.9
FOLLOWED = ["acc_aeb", "acc_only", "cc_human", "fsm", "reg157", "rss"]


def encounters(n=60):
    generator = np.random.default_rng(7)
    closing_speed = generator.uniform(-2, 25, n)
    range_ = generator.uniform(0.2, 2.0, n) * (closing_speed**2 / 12 + np.abs(closing_speed)) + 0.5
    return np.array([generator.uniform(2, 35, n), range_, closing_speed]).T.tolist()


def outcomes_of(trace, range_, in_lane):
    """Outcomes as the trace tells them: crash, smallest range, smallest TTC, impact speed."""
    last = trace.iloc[-1]
    crash = in_lane.iloc[-1] and last.range_m <= 0
    lane = trace[in_lane & ((trace.lead_position_m > trace.host_position_m - 4.3) | (trace.range_m <= 0))]
    ttc = min(lane.time_to_collision_s, default=np.inf)
    impact = last.host_speed_m_per_s - last.lead_speed_m_per_s if crash else 0.0
    return [crash, min([range_, *lane.range_m]), ttc, impact]


def simulated(vehicle, encounter):
    outcomes = vehicle.simulate(*([value] for value in encounter))
    return [getattr(outcomes, name)[0] for name in CUT_IN.outcome_names]


def test_a_figure_that_cannot_be_written_leaves_no_table(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "f.png").mkdir()
    assert cli.main(["replay", "20", "15", "6", "o.csv", "--figure", "f.png"]) == 2
    assert "f.png is a folder" in capsys.readouterr().err
    assert [each.name for each in tmp_path.iterdir()] == ["f.png"]


@pytest.mark.parametrize("name", FOLLOWED)
def test_a_trace_ends_in_exactly_the_outcomes(name):
    crashes = 0
    for encounter in encounters():
        trace = trace_encounter(name, *encounter, scenario=CUT_IN)
        assert list(trace) == list(COLUMNS)
        everywhere = pd.Series(True, index=trace.index)
        got, wanted = outcomes_of(trace, np.inf, everywhere), simulated(load_vehicle(name), encounter)
        assert np.array(got, dtype=float).tobytes() == np.array(wanted, dtype=float).tobytes()
        crashes += wanted[0]
    assert 2 < crashes < 60


@pytest.mark.parametrize("name", ["cc_human", "fsm", "reg157", "rss"])
def test_a_trace_with_lateral_motion_ends_in_the_outcomes(name):
    vehicle = load_vehicle(name, lateral_speed=0.6)
    for encounter in encounters():
        trace = vehicle.trace(*encounter)
        got = outcomes_of(trace, encounter[1], trace.lateral_distance_m.abs() < WIDTH)
        wanted = simulated(vehicle, encounter)
        if wanted[0] and np.isinf(got[2]):  # contact from the side: the TTC is that of the approach before it
            got[2] = min(*trace.time_to_collision_s, encounter[1] / encounter[2])
        np.testing.assert_allclose(np.array(got, float), np.array(wanted, float), rtol=0, atol=1e-9)


@pytest.mark.parametrize("name", FOLLOWED)
def test_a_trace_obeys_the_laws_of_motion(name):
    encounter = (20.0, 30.0, 14.0)
    trace = trace_encounter(name, *encounter, scenario=CUT_IN)
    assert len(trace) > 10
    step = np.diff(trace.time_s)
    np.testing.assert_allclose(step, 0.1, atol=1e-9)
    speed = trace.host_speed_m_per_s
    np.testing.assert_allclose(np.diff(speed), trace.host_acceleration_m_per_s2[1:] * step, atol=1e-9)
    before, after = speed.to_numpy()[:-1], speed.to_numpy()[1:]
    moved = step * ((before + after) / 2 if name.startswith("acc") else after)  # as each model is defined
    np.testing.assert_allclose(np.diff(trace.host_position_m), moved, atol=1e-9)
    np.testing.assert_allclose(trace.lead_position_m, 30 + 20 * trace.time_s, atol=1e-9)
    np.testing.assert_allclose(trace.range_m, trace.lead_position_m - trace.host_position_m, atol=1e-9)
    expected = {"acc_only": {0}, "acc_aeb": {0}, "cc_human": {0, 1}, "reg157": {0, 1}}
    assert set(trace.emergency) == expected.get(name, {1})


def test_the_emergency_of_the_car_is_its_aeb():
    assert trace_encounter("acc_aeb", 20.0, 14.0, 14.0, scenario=CUT_IN).emergency.any()
    assert not trace_encounter("acc_only", 20.0, 14.0, 14.0, scenario=CUT_IN).emergency.any()


def test_the_command(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    options = ["--figure", "out.png", "--vehicle", "cc_human"]
    assert cli.main(["replay", "20", "9", "8", "out.csv", *options]) == 0
    expected = trace_encounter("cc_human", 20.0, 9.0, 8.0, scenario=CUT_IN)
    pd.testing.assert_frame_equal(pd.read_csv("out.csv"), expected)
    assert (tmp_path / "out.png").read_bytes().startswith(b"\x89PNG")
    assert cli.main(["replay", "20", "9", "-8", "out.csv", "--figure", "out.svg"]) == 0
    first = (tmp_path / "out.svg").read_bytes()
    assert cli.main(["replay", "20", "9", "-8", "out.csv", "--figure", "out.svg"]) == 0
    assert (tmp_path / "out.svg").read_bytes() == first
    assert not capsys.readouterr().err


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["20", "0", "8", "new.csv"], "row 0, column range: seen 0.0; expected a range above 0 m"),
        (["20", "9", "8", "new.csv", "--vehicle", "cc"], "vehicle: seen 'cc'; expected acc_aeb"),
        (["20", "9", "8", "new.csv", "--figure", "x.bmp"], "x.bmp: seen '.bmp'; expected .png, .pdf or .svg"),
        (["20", "9", "8", "new.csv", "--vehicle", "mine.py:Car"], "seen mine.py:Car; expected one whose"),
        (
            ["9", "9", "9", "new.csv", "--scenario", "left_turn", "--motion", "ngsim"],
            "--motion: seen the scenario left_turn; expected cut_in",
        ),
    ],
)
def test_bad_arguments(tmp_path, monkeypatch, capsys, arguments, message):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "mine.py").write_text("class Car:\n    def simulate(self, *encounters):\n        pass\n")
    assert cli.main(["replay", *arguments]) == 2
    error = capsys.readouterr().err
    assert error.count("\n") == 1
    assert message in error
    assert [path.name for path in tmp_path.iterdir() if path.name != "__pycache__"] == ["mine.py"]


@pytest.mark.parametrize("name", [*FOLLOWED, "human"])
def test_a_trace_with_lead_motion_ends_in_the_outcomes(name):
    crashes = 0
    for encounter in encounters(30):
        motion = lead_speeds_of("ngsim", np.array(encounter), np.random.default_rng(1))
        trace = trace_encounter(name, *encounter, lead_speeds=motion, scenario=CUT_IN)
        wanted = load_vehicle(name).simulate_moving(*([value] for value in encounter), [motion])
        everywhere = pd.Series(True, index=trace.index)
        got = outcomes_of(trace, np.inf, everywhere)
        if name == "human":  # whose time to collision at the contact is that of the step before
            got[2], got[0] = wanted.min_ttc[0], wanted.crash[0]
        # The smallest range of a driver lies within a step, where the approach ends.
        limit = 0.01 if name == "human" else 1e-9
        expected = [getattr(wanted, each)[0] for each in CUT_IN.outcome_names]
        np.testing.assert_allclose(np.array(got, float), expected, rtol=0, atol=limit)
        lead = np.interp(trace.time_s, 0.1 * np.arange(81), motion)
        np.testing.assert_allclose(trace.lead_speed_m_per_s, lead, atol=1e-9)
        np.testing.assert_allclose(trace.lead_position_m - trace.host_position_m, trace.range_m, atol=1e-9)
        crashes += wanted.crash[0]
    assert 0 < crashes < 30


def test_a_replay_shows_lead_motion_by_name_and_from_a_file(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    table = ["20", "30", "4"]
    assert cli.main(["replay", *table, "drawn.csv", "--motion", "ngsim", "--seed", "3"]) == 0
    drawn = pd.read_csv("drawn.csv")
    assert drawn["time_s"].iloc[-1] == 8.0
    assert drawn["lead_speed_m_per_s"].nunique() > 50
    assert cli.main(["replay", *table, "again.csv", "--motion", "drawn.csv", "--figure", "again.png"]) == 0
    pd.testing.assert_frame_equal(pd.read_csv("again.csv"), drawn, rtol=1e-6)
    assert cli.main(["replay", *table, "still.csv"]) == 0
    assert cli.main(["replay", *table, "constant.csv", "--motion", "constant"]) == 0
    pd.testing.assert_frame_equal(pd.read_csv("constant.csv"), pd.read_csv("still.csv"))
    assert not capsys.readouterr().err


@pytest.mark.parametrize(
    ("content", "options", "message"),
    [
        (
            "0,20\n4,-1\n8,20\n",
            [],
            "motion.csv: seen a lead speed of -1 m/s at 4 s; expected speeds of 0",
        ),
        ("0,20\n4,inf\n8,20\n", [], "row 3, column lead_speed_m_per_s: seen 'inf'"),
        ("0,20\n4,\n8,20\n", [], "row 3, column lead_speed_m_per_s: seen nan"),
        (
            "0,20\n3,20\n3.5,90\n8,90\n",
            [],
            "motion.csv: seen 20 m/s at 3 s and 90 m/s at 3.5 s; expected speeds in m/s that change",
        ),
        ("0,20\n4,20\n", [], "motion.csv: seen times up to 4 s; expected times up to 8 s or more"),
        ("0,20\n0,20\n8,20\n", [], "seen 0, 0, 8; expected times that increase from 0"),
        ("0,19\n8,20\n", [], "encounter 0, at 0 s: seen 19.0; expected the lead speed of the encounter"),
        (
            "0,20\n8,20\n",
            ["--motion", "fast"],
            "--motion: seen 'fast'; expected constant or ngsim, or a file",
        ),
        ("0,20\n8,20\ninf,20\n", [], "row 4, column time_s: seen 'inf'; expected a finite number"),
        ("0,20\n100,20\n8000,20\n", [], "motion.csv: seen times 7900 s apart; expected times in seconds"),
        ("0,20\n8,20\n", ["--motion", "none.csv"], "none.csv: seen no such file"),
        ("0,20\n8,20\n", ["--motion", "ngsim", "--seed", "-1"], "--seed: seen -1"),
    ],
)
def test_bad_lead_motion_is_one_message(tmp_path, monkeypatch, capsys, content, options, message):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "motion.csv").write_text("time_s,lead_speed_m_per_s\n" + content)
    assert cli.main(["replay", "20", "30", "4", "new.csv", "--motion", "motion.csv", *options]) == 2
    error = capsys.readouterr().err
    assert error.count("\n") == 1
    assert message in error
    assert not (tmp_path / "new.csv").exists()
