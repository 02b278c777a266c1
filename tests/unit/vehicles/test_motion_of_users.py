"""Lead motion for the vehicles of users: a class, a command, an FMU; tables of `simulate`; bad input."""

import os
import sys

import numpy as np
import pandas as pd
import pytest
from accelerated_evaluation import InputError, cli, load_vehicle
from accelerated_evaluation.laws.motion import MOTIONS, SPEED_COLUMNS, STATES, STEP, draw_lead_speeds
from accelerated_evaluation.scenarios.cut_in import CUT_IN
from accelerated_evaluation.vehicles.moving import takes_motion
from accelerated_evaluation.vehicles.named import NamedVehicle

CLASS = """
from accelerated_evaluation.vehicles import AccAeb

class Still:
    deterministic = True

    def simulate(self, lead_speed, range_, closing_speed):
        return AccAeb().simulate(lead_speed, range_, closing_speed)

class Moving(Still):
    def simulate_moving(self, lead_speed, range_, closing_speed, lead_speeds):
        return AccAeb().simulate_moving(lead_speed, range_, closing_speed, lead_speeds)

class Negative(Moving):
    def simulate_moving(self, *given):
        outcomes = super().simulate_moving(*given)
        outcomes.min_range[:] = -1.0
        return outcomes
"""
ENCOUNTERS = np.array([[20.0, 12.0, 8.0], [10.0, 30.0, 4.0], [5.0, -1.0, 7.0]])
SPEEDS = draw_lead_speeds(MOTIONS["ngsim"](), ENCOUNTERS, np.random.default_rng(1))
OWN = [sys.executable, "-m", "accelerated_evaluation.cli", "simulate"]


@pytest.fixture
def file(tmp_path):
    (tmp_path / "cars.py").write_text(CLASS)
    return str(tmp_path / "cars.py")


def assert_same(got, wanted):
    for name in CUT_IN.outcome_names:
        np.testing.assert_allclose(getattr(got, name), getattr(wanted, name), rtol=1e-9, atol=1e-9)


def test_a_class_may_take_lead_motion(file):
    vehicle, own = load_vehicle(f"{file}:Moving"), load_vehicle("acc_aeb")
    assert takes_motion(vehicle)
    assert_same(vehicle.simulate_moving(*ENCOUNTERS, SPEEDS), own.simulate_moving(*ENCOUNTERS, SPEEDS))
    assert not takes_motion(load_vehicle(f"{file}:Still"))
    with pytest.raises(InputError, match=r"cars\.py:Still, lead speeds over time: seen a vehicle"):
        load_vehicle(f"{file}:Still").simulate_moving(*ENCOUNTERS, SPEEDS)
    with pytest.raises(InputError, match=r"cars\.py:Negative, min_range\[\d\] of the encounter"):
        load_vehicle(f"{file}:Negative").simulate_moving(*ENCOUNTERS, SPEEDS)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda speeds: speeds[:, :50], r"seen an array of shape \(3, 50\); expected 3 rows of 81 speeds"),
        (lambda speeds: speeds - 100 * (np.arange(STATES) == 20), "encounter 0, at 2 s: .* 0 m/s or more"),
        (lambda speeds: speeds * np.where(np.arange(STATES) == 9, np.inf, 1), "at 0.9 s: seen inf"),
    ],
)
def test_bad_lead_motion_of_a_class_is_one_message(file, change, message):
    with pytest.raises(InputError, match=message):
        load_vehicle(f"{file}:Moving").simulate_moving(*ENCOUNTERS, change(SPEEDS))


def test_the_study_s_own_command_takes_lead_motion():
    """The command simulate reads the columns that a command is given."""
    command, own = load_vehicle("command", command=OWN, lead_motion=True), load_vehicle("acc_aeb")
    assert_same(command.simulate_moving(*ENCOUNTERS, SPEEDS), own.simulate_moving(*ENCOUNTERS, SPEEDS))
    with pytest.raises(InputError, match="seen a vehicle for lead vehicles that keep their speed"):
        load_vehicle("command", command=OWN).simulate_moving(*ENCOUNTERS, SPEEDS)
    with pytest.raises(InputError, match="lead_motion: seen 'yes'; expected True or False"):
        load_vehicle("command", command=OWN, lead_motion="yes")


def test_a_slow_vehicle_takes_lead_motion_on_its_workers(file, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    simulations = {"executor": "processes", "workers": 1, "batch_size": 2, "time_limit": 60.0}
    simulations |= {"keep_class": True, "options": {}}
    for name in ("Moving", "Still"):
        section = {"name": f"{file}:{name}", "parameters": {}, "files": []}
        with NamedVehicle.of(section, simulations, CUT_IN).loaded() as vehicle:
            if name == "Still":
                with pytest.raises(InputError, match=r"cars\.py:Still, lead speeds over time"):
                    vehicle.simulate_moving(*ENCOUNTERS, SPEEDS)
                continue
            got = vehicle.simulate_moving(*ENCOUNTERS, SPEEDS)
            assert len(vehicle.store) == 0
    assert_same(got, load_vehicle("acc_aeb").simulate_moving(*ENCOUNTERS, SPEEDS))


def written(path, **changes):
    table = pd.DataFrame(ENCOUNTERS.T, columns=["lead_speed", "range", "closing_speed"])
    table = table.join(pd.DataFrame(SPEEDS[:, 1:STATES], columns=list(SPEED_COLUMNS)))
    table.assign(**changes).to_csv(path, index=False)
    return table


def test_a_table_of_simulate_may_have_lead_motion(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    written("in.csv")
    assert cli.main(["simulate", "in.csv", "out.csv"]) == 0
    wanted = load_vehicle("acc_aeb").simulate_moving(*ENCOUNTERS, SPEEDS)
    np.testing.assert_allclose(pd.read_csv("out.csv")["min_range"], wanted.min_range, rtol=1e-9)
    pd.DataFrame(ENCOUNTERS.T, columns=["lead_speed", "range", "closing_speed"]).assign(
        **{"speed_4": ENCOUNTERS[0] - 2, "speed_8": ENCOUNTERS[0] - 4}
    ).to_csv("rare.csv", index=False)
    assert cli.main(["simulate", "rare.csv", "out.csv"]) == 0
    linear = ENCOUNTERS[0][:, None] - 0.5 * STEP * np.arange(STATES)
    wanted = load_vehicle("acc_aeb").simulate_moving(*ENCOUNTERS, linear)
    np.testing.assert_allclose(pd.read_csv("out.csv")["min_range"], wanted.min_range, rtol=1e-9)


@pytest.mark.parametrize(
    ("changes", "options", "message"),
    [
        ({"speed_0.3": -1.0}, [], "in.csv, row 2, column speed_0.3: seen -1.0; expected a finite speed"),
        ({"speed_0.1": 72.0}, [], "in.csv, row 2, columns lead_speed and speed_0.1: seen 20 and 72 m/s, 0.1"),
        ({"speed_0.1": 20 / 3.6}, [], "row 2, columns lead_speed and speed_0.1: seen 20 and 5.5"),
        ({"speed_0.1": 2e300}, [], "row 2, columns lead_speed and speed_0.1: seen 20 and 2e+300 m/s"),
        ({"speed_0.1": np.inf}, [], "row 2, column speed_0.1: seen 'inf'; expected a finite number"),
        ({"speed_8.0": "nan"}, [], "in.csv, row 2, column speed_8.0: seen 'nan'"),
        ({"speed_8.0": "fast"}, [], "in.csv, row 2, column speed_8.0: seen 'fast'; expected a finite number"),
        ({}, ["--vehicle", "cars.py:Still"], "cars.py:Still, lead speeds over time: seen a vehicle for lead"),
    ],
)
def test_bad_lead_motion_in_a_table_is_one_message(
    file, tmp_path, monkeypatch, capfd, changes, options, message
):
    monkeypatch.chdir(tmp_path)
    written("in.csv", **changes)
    assert cli.main(["simulate", "in.csv", "out.csv", *options]) == 2
    assert message in capfd.readouterr().err
    assert not os.path.exists("out.csv")


MISSPELT = (
    "speed", "speeds", "Speed_2", "SPEED_2", "speed_2s", "speed 2", "speed-2", "speed__2", "speed_ 2",
    "speed_2,5", "speed_-1", "speed_+2", "speed_1e1", "speed_0x2", "speed_nan", "speed_inf", "lead_speed_2",
)  # fmt: skip


@pytest.mark.parametrize(
    ("names", "message"),
    [
        *(([name], f"seen '{name}'; expected columns of lead speeds named speed_0.1") for name in MISSPELT),
        (["speed_2", "speed_2.0"], "seen speed_2 and speed_2.0; expected one column for each time"),
        (["speed_0", "speed_8"], "seen lead_speed and speed_0; expected one column for each time"),
        (["speed_9"], "seen no column between 0 and 9 s; expected times in seconds, at most 8 s apart"),
        (["speed_100"], "seen no column between 0 and 100 s; expected times in seconds"),
        (["speed_2"], "seen speeds up to 2 s; expected columns such as speed_0.2, up to 8 s"),
    ],
)
def test_columns_that_begin_like_lead_speeds_are_read_or_refused(
    tmp_path, monkeypatch, capfd, names, message
):
    """A column that is not read would silently give the outcomes behind a car that keeps its speed."""
    monkeypatch.chdir(tmp_path)
    pd.DataFrame([dict.fromkeys(["lead_speed", "range", "closing_speed", *names], 20)]).to_csv(
        "in.csv", index=False
    )
    assert cli.main(["simulate", "in.csv", "out.csv"]) == 2
    assert f"in.csv, columns speed_...: {message}" in capfd.readouterr().err
    assert not os.path.exists("out.csv")
