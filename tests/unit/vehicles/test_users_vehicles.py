"""Vehicles from a user's own file: loading them, and what they may give."""

import warnings

import numpy as np
import pytest
from accelerated_evaluation import InputError, Vehicle, load_vehicle
from accelerated_evaluation.vehicles.external.checked import REPEATED

USER_FILE = """
import os
from dataclasses import dataclass

import numpy as np
from accelerated_evaluation.vehicles import Outcomes


@dataclass(frozen=True)
class Coasting:
    seconds: float = 8.0

    def simulate(self, lead_speed, range_, closing_speed):
        last = range_ - np.maximum(closing_speed, 0) * self.seconds
        crash = last <= 0
        with np.errstate(divide="ignore"):
            ttc = np.where(closing_speed > 0, np.maximum(last, 1e-9) / closing_speed, np.inf)
        return Outcomes(crash, last, ttc, np.where(crash, closing_speed, 0))


class Odd:
    def __init__(self, outcome, value):
        self.change = {outcome: value}

    def simulate(self, lead_speed, range_, closing_speed):
        fields = vars(Coasting().simulate(lead_speed, range_, closing_speed)) | self.change
        return Outcomes(**fields)


class Broken:
    def simulate(self, lead_speed, range_, closing_speed):
        range_[:] = 0
        return 1 // 0


class Nothing:
    def simulate(self, lead_speed, range_, closing_speed):
        return None


class Inert:
    pass


class Exits:
    def __init__(self, error="SystemExit", where="simulate"):
        self.error = {"SystemExit": SystemExit(0), "GeneratorExit": GeneratorExit("gone")}[error]
        if where == "init":
            self.leave()

    def leave(self):
        raise self.error

    def simulate(self, lead_speed, range_, closing_speed):
        self.leave()


class Reusing(Coasting):
    # Writes every batch into the same arrays.
    def simulate(self, lead_speed, range_, closing_speed):
        new = vars(super().simulate(lead_speed, range_, closing_speed))
        if not hasattr(Reusing, "kept") or len(Reusing.kept["crash"]) < len(range_):
            Reusing.kept = {name: values.copy() for name, values in new.items()}
        for name, values in new.items():
            Reusing.kept[name][: len(range_)] = values
        return Outcomes(**{name: values[: len(range_)] for name, values in Reusing.kept.items()})


class Unreliable:
    def __init__(self, how):
        self.how, self.calls, self.simulated = how, 0, 0
        self.generator = np.random.default_rng(1)

    def simulate(self, lead_speed, range_, closing_speed):
        n = len(range_)
        self.calls, self.simulated = self.calls + 1, self.simulated + n
        change = {
            "none": 0.0,
            "rounding": 1e-9 * self.calls,
            "random": self.generator.random(n),
            "state": self.calls,
            "size": n,
            "place": np.arange(n),
            "late place": 1.0 * (np.arange(n) > 19),
            "neighbours": np.cumsum(range_),
        }[self.how]
        never = np.zeros(n, dtype=bool)
        return Outcomes(never, range_ / 2, 1.0 + change * np.ones(n), 0.0 * range_)
"""


@pytest.fixture
def user_file(tmp_path):
    path = tmp_path / "mine.py"
    path.write_text(USER_FILE)
    return path


def test_users_own_vehicle(user_file):
    vehicle = load_vehicle(f"{user_file}:Coasting", seconds=4)
    assert isinstance(vehicle, Vehicle)
    outcomes = vehicle.simulate([20, 20], [10, 10], [5, 2])
    assert outcomes.crash.tolist() == [True, False]
    assert outcomes.min_range.tolist() == [-10.0, 2.0]
    with pytest.raises(InputError, match="row 1, column range"):
        vehicle.simulate([20, 20], [10, 0], [5, 2])


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (("crash", [False]), r"crash: seen shape \(1,\); expected shape \(2,\)"),
        (("crash", [1, 0]), "crash: seen an array of int64; expected an array of booleans"),
        (("min_ttc", ["a", "b"]), "min_ttc: seen an array of <U1; expected an array of real numbers"),
        (
            ("min_range", [-1, np.nan]),
            r"min_range\[1\] of the encounter .*, range 10, closing_speed 1: seen nan",
        ),
        (("min_range", [-1, 11]), r"min_range\[1\] of .*: seen 11.0; expected at most the initial range"),
        (("min_range", [1, 1]), r"min_range\[0\] of .*: seen 1.0; expected 0 m or less where crash is true"),
        (("min_range", [-1, -1]), r"min_range\[1\] of .*: seen -1.0; expected above 0 m where crash is"),
        (("min_ttc", [1, 0]), r"min_ttc\[1\] of .*: seen 0.0"),
        (("min_ttc", [1, np.nan]), r"min_ttc\[1\] of .*: seen nan"),
        (("impact_speed", [np.inf, 0]), r"impact_speed\[0\] of .*: seen inf"),
        (("impact_speed", [1, 2]), r"impact_speed\[1\] of .*: seen 2.0; expected 0 m/s where crash is false"),
    ],
)
def test_users_vehicle_that_breaks_the_protocol(user_file, change, message):
    vehicle = load_vehicle(f"{user_file}:Odd", outcome=change[0], value=change[1])
    with pytest.raises(InputError, match=message):
        vehicle.simulate([20, 20], [10, 10], [5, 1])


def test_outcomes_survive_a_vehicle_that_reuses_its_arrays(user_file):
    vehicle = load_vehicle(f"{user_file}:Reusing")
    first = vehicle.simulate([20, 20, 20], [10, 10, 10], [5, 1, 2])
    vehicle.simulate([20, 20, 20], [10, 10, 10], [1, 5, 5])
    assert first.crash.tolist() == [True, False, True]
    assert first.min_range.tolist() == [-30.0, 2.0, -6.0]


@pytest.mark.parametrize("how", ["random", "state", "size", "place", "neighbours"])
@pytest.mark.parametrize("n", [1, 2, 50])
def test_users_vehicle_that_gives_other_outcomes_again(user_file, how, n):
    vehicle = load_vehicle(f"{user_file}:Unreliable", how=how)
    message = r"min_ttc of the encounter lead_speed 20, range .* when simulated again in another batch; "
    encounters = np.full(n, 20.0), np.linspace(10, 90, n), np.full(n, 5.0)
    with pytest.warns(UserWarning, match=message):
        vehicle.simulate(*encounters)
    assert vehicle.deterministic is False
    vehicle = load_vehicle(f"{user_file}:Unreliable", how=how)
    vehicle.deterministic = True
    with pytest.raises(InputError, match=message):
        vehicle.simulate(*encounters)


def test_a_place_in_a_batch_that_is_ten_times_as_large_is_tested_again(user_file):
    vehicle = load_vehicle(f"{user_file}:Unreliable", how="late place")
    sound = load_vehicle(f"{user_file}:Unreliable", how="none")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        for size in (1, 10, 11, 200):
            sound.simulate(np.full(size, 20.0), np.linspace(10, 90, size), np.full(size, 5.0))
        vehicle.simulate([20.0], [10.0], [5.0])
    with pytest.warns(UserWarning, match="when simulated again in another batch"):
        vehicle.simulate(np.full(50, 20.0), np.linspace(10, 90, 50), np.full(50, 5.0))
    assert vehicle.deterministic is False
    assert sound.vehicle.simulated == 1 + 10 + 11 + 200 + 2 + 8 + 8


@pytest.mark.parametrize("how", ["none", "rounding"])
def test_the_repetition_costs_few_simulations_once(user_file, how):
    vehicle = load_vehicle(f"{user_file}:Unreliable", how=how)
    vehicle.simulate([], [], [])
    for _ in range(3):
        vehicle.simulate(np.full(50, 20.0), np.linspace(10, 90, 50), np.full(50, 5.0))
    assert vehicle.vehicle.simulated == 3 * 50 + 2 * REPEATED


@pytest.mark.parametrize(
    ("error", "reported"),
    [
        ("SystemExit", "SystemExit: 0"),
        ("GeneratorExit", "GeneratorExit: gone"),
    ],
)
def test_users_vehicle_that_exits(user_file, error, reported):
    vehicle = load_vehicle(f"{user_file}:Exits", error=error)
    with pytest.raises(InputError, match=f"Exits, simulate: seen {reported}; expected outcomes"):
        vehicle.simulate([20], [10], [5])
    with pytest.raises(InputError, match=f"Exits: seen {reported}"):
        load_vehicle(f"{user_file}:Exits", error=error, where="init")


def test_an_interruption_at_the_keyboard_is_not_the_vehicles(user_file):
    vehicle = load_vehicle(f"{user_file}:Exits")
    vehicle.vehicle.error = KeyboardInterrupt()
    with pytest.raises(KeyboardInterrupt):
        vehicle.simulate([20], [10], [5])


@pytest.mark.parametrize(
    ("class_name", "message"), [("Broken", "simulate: seen ZeroDivisionError"), ("Nothing", "seen NoneType")]
)
def test_users_vehicle_that_fails(user_file, class_name, message):
    with pytest.raises(InputError, match=message):
        load_vehicle(f"{user_file}:{class_name}").simulate([20], [10], [5])


@pytest.mark.parametrize(
    ("name", "parameters", "message"),
    [
        ("acc_abe", {}, "seen 'acc_abe'; expected acc_aeb, acc_only, .* or path.* Did you mean acc_aeb"),
        ("acc_aeb", {"aeb_jrk": 1}, "parameter 'aeb_jrk'.* Did you mean aeb_jerk?"),
        ("acc_only", {"aeb": True}, "parameter 'aeb'"),
        ("nowhere.py:Car", {}, "no file nowhere.py"),
        ("a\0b.py:Car", {}, "no file a"),
        ("a" * 300 + ".py:Car", {}, "no file aaa"),
        ("{file}", {}, "mine.py: seen no class; expected path/to/file.py:ClassName"),
        ("{file}:Costing", {}, "no class 'Costing'; .* Coasting, Odd, .* Did you mean Coasting?"),
        ("{file}:Inert", {}, "no method simulate"),
        ("{file}:Coasting", {"minutes": 1}, "TypeError: .*minutes"),
        ("{folder}/wrong.py:Car", {}, "SyntaxError"),
        ("{folder}/leaves.py:Car", {}, "SystemExit: 0; expected a file that Python can import"),
        ("{folder}/plain.txt:Car", {}, "ends in .py"),
    ],
)
def test_vehicles_that_cannot_be_loaded(user_file, name, parameters, message):
    user_file.with_name("wrong.py").write_text("def")
    user_file.with_name("leaves.py").write_text("import sys; sys.exit(0)")
    user_file.with_name("plain.txt").write_text("")
    with pytest.raises(InputError, match=message):
        load_vehicle(name.format(file=user_file, folder=user_file.parent), **parameters)
