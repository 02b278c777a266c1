"""A program that stays: its protocol, every way to break it, and workers that are lost."""

import sys
import time
from pathlib import Path

import numpy as np
import pytest
from accelerated_evaluation import InputError, load_vehicle
from accelerated_evaluation.scenarios.cut_in import CUT_IN
from accelerated_evaluation.vehicles.named import NamedVehicle

# A host that keeps its speed for 8 s. It notes every start and every run in the file LOG.
CAR = """
import csv, json, os, signal, subprocess, sys, time

ODD = {"unknown": {"id": 77}, "error": {"error": "lost map"}, "null": {"min_ttc": None}}
ODD["text"] = {"min_range": "?"}


def outcomes(start, closing):
    last = start - max(closing, 0) * 8
    ttc = max(last, 0.01) / closing if closing > 0 else float("inf")
    return {"crash": last <= 0, "min_range": last, "min_ttc": ttc, "impact_speed": closing * (last <= 0)}


class Car:
    def simulate(self, lead_speed, range_, closing_speed):
        import numpy as np
        from accelerated_evaluation import Outcomes
        rows = [outcomes(*pair) for pair in zip(range_.tolist(), closing_speed.tolist())]
        return Outcomes(**{name: np.array([row[name] for row in rows]) for name in rows[0]})


def note(text):
    with open("log", "a") as log:
        log.write(text + "\\n")


def write_table(source, target):
    table = csv.DictReader(open(source))
    rows = [outcomes(float(row["range"]), float(row["closing_speed"])) for row in table]
    with open(target, "w", newline="") as file:
        table = csv.DictWriter(file, list(rows[0]))
        table.writeheader()
        table.writerows({**row, "crash": int(row["crash"])} for row in rows)


def converse(trouble):
    if trouble == "banner":
        print("My Engine 3.0\\n  loading the map ...")
    if trouble == "no greeting":
        time.sleep(60)
    if trouble == "other greeting":
        print('{"version": 1}', flush=True)
    print('{"name": "a car", "version": "1"}', flush=True)
    if trouble == "prints":
        sys.stderr.write("noise\\n" * 2_000_000)
    for number, line in enumerate(sys.stdin):
        asked = json.loads(line)
        note(f"run {asked['range']}")
        answer = {"id": asked["id"], **outcomes(asked["range"], asked["closing_speed"])}
        if answer["min_ttc"] == float("inf"):
            answer["min_ttc"] = "inf"
        at_second = number == 1
        text = json.dumps(answer | (ODD.get(trouble, {}) if at_second else {}))
        if trouble == "dies once" and asked["range"] == 11 and open("log").read().count("run 11") == 1:
            os.kill(os.getpid(), signal.SIGKILL)
        if trouble == "kills worker" and asked["range"] == 11 and open("log").read().count("run 11") == 1:
            os.kill(os.getppid(), signal.SIGKILL)
        if trouble == "dies always" and asked["range"] == 11:
            sys.exit("no licence")
        if trouble == "dies" and at_second:
            sys.exit("no licence")
        if trouble == "half" and at_second:
            print(text[:20], end="", flush=True)
            sys.exit(3)
        if trouble == "never" and at_second:
            time.sleep(60)
        if trouble == "child" and at_second:
            subprocess.Popen(["sleep", "60"])
            sys.exit(3)
        if at_second:
            text = {"no JSON": "{oops", "list": f"[{text}]", "list later": f"[0, {text}]"}.get(trouble, text)
        if trouble == "odd bytes":
            text = "\\ufeff" + json.dumps(answer | {"trace": "x" * 1_000_000}) + "\\r"
        if trouble == "no UTF-8" and at_second:
            sys.stdout.buffer.write(b'{"id": "\\xff"}\\n')
            sys.stdout.flush()
        if trouble == "talks":
            print("step 1 of 3")
        print(text, flush=True)
        if trouble == "twice":
            print(text, flush=True)
    if trouble == "stays for ever":
        time.sleep(60)


if __name__ == "__main__":
    note("start")
    write_table(*sys.argv[1:]) if len(sys.argv) == 3 else converse(sys.argv[1])
"""
ENCOUNTERS = [[20.0, 20.0, 20.0], [10.0, 10.0, 30.0], [5.0, 1.0, 0.0]]
SIMULATIONS = {"batch_size": 5, "time_limit": 30.0, "workers": 2}


@pytest.fixture(autouse=True)
def _here(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("car.py").write_text(CAR)


def staying(trouble, time_limit=20.0):
    vehicle = load_vehicle("command", command=[sys.executable, "car.py", trouble], stays=True)
    vehicle.vehicle.time_limit = time_limit
    return vehicle


def named(trouble, **changes):
    parameters = {"command": [sys.executable, "car.py", trouble], "stays": True}
    section = {"name": "command", "parameters": parameters, "files": [], "deterministic": True}
    return NamedVehicle.of(section, SIMULATIONS, CUT_IN, **changes).loaded(is_tested=False)


def columns(outcomes):
    return [getattr(outcomes, name).tolist() for name in CUT_IN.outcome_names]


def logged(word):
    return Path("log").read_text().split("\n").count(word)


def run(vehicle, ranges):
    return vehicle.simulate(np.full(len(ranges), 20.0), ranges, np.full(len(ranges), 1.0))


@pytest.mark.parametrize("trouble", ["none", "banner", "talks", "prints", "odd bytes", "stays for ever"])
def test_one_start_for_all_batches_and_the_outcomes_of_the_class(trouble):
    vehicle = staying(trouble)
    assert vehicle.simulate(*ENCOUNTERS).min_ttc.tolist() == [0.002, 2.0, np.inf]
    numbers = np.random.default_rng(1).uniform([[5], [1], [-2]], [[20], [30], [18]], (3, 40))
    found = [columns(vehicle.simulate(*numbers))]
    if trouble == "none":  # a program that stays, one that is started for each batch, and a class
        command = load_vehicle("command", command=[sys.executable, "car.py"])
        found += [columns(each.simulate(*numbers)) for each in (command, load_vehicle("car.py:Car"))]
        assert found[0] == found[1] == found[2]
        assert logged("start") == 1 + 2  # the command: a batch, and its repetition
    else:
        assert logged("start") == 1
    begun = time.monotonic()
    vehicle.vehicle._program.end()
    assert time.monotonic() - begun < 20


@pytest.mark.parametrize(
    ("trouble", "message"),
    [
        ("no greeting", "start: seen no line within 1 s; expected one line of JSON with the name"),
        ("other greeting", "start: seen '{\"version\": 1}'; expected one line of JSON with the name"),
        ("dies", "closing_speed 1: seen its end with exit status 1, and printed last 'no licence'"),
        ("half", "seen its end with exit status 3 in the middle of the line '{\"id\": 2, "),
        ("never", "seen no line within 1 s; .*Make the program faster, or raise simulations.time_limit"),
        ("unknown", "seen '{\"id\": 77, .*'; expected one line of JSON with \"id\": 2 and the outcomes"),
        ("twice", "seen '{\"id\": 1, .*'; expected one line of JSON with \"id\": 2 and the outcomes"),
        ("error", "range 10, closing_speed 1: seen '{\"id\": 2, .*, \"error\": \"lost map\"}'"),
        ("null", "outcome min_ttc of the encounter lead_speed 20, range 10, closing_speed 1: seen ''"),
        ("text", "outcome min_range of the encounter .*: seen '\\?'; expected a number"),
        ("no JSON", "seen '{oops'; expected one line of JSON with \"id\": 2 and the outcomes"),
        ("list", r"seen '\[\{\"id\": 2, .*'; expected one line of JSON with \"id\": 2 and the outcomes"),
        ("list later", r"seen no line within 1 s that begins with \{, but '\[0, \{\"id\": 2, "),
        ("no UTF-8", r"seen '\{\"id\": \"\\\\xff\"\}'; expected"),
        ("child", "closing_speed 1: seen its end with exit status 3; expected"),
    ],
)  # fmt: skip
def test_programs_that_break_the_protocol(trouble, message):
    vehicle = staying(trouble, 1.0 if trouble in ("no greeting", "never", "list later") else 20.0)
    with pytest.raises(InputError, match=message) as error:
        vehicle.simulate(*ENCOUNTERS)
    assert "docs/staying_program.md" in error.value.change
    assert trouble.partition(" ")[2] != "greeting" or logged("start") == 1
    if vehicle.vehicle._program is not None:  # a program that gave a wrong number may go on
        vehicle.vehicle._program.end()


def test_a_program_that_fails_is_started_again():
    vehicle = staying("dies")
    for _ in range(2):
        with pytest.raises(InputError, match="no licence"):
            vehicle.simulate(*ENCOUNTERS)
    assert logged("start") == 2


@pytest.mark.parametrize("executor", ["processes", "dask"])
def test_one_start_for_each_worker(executor):
    if executor == "dask":
        pytest.importorskip("distributed", reason="Dask, the extra 'cluster', is not installed")
    ranges = np.arange(1.0, 41.0)
    with named("none", executor=executor) as vehicle:
        run(vehicle, ranges)
        run(vehicle, ranges + 0.5)
        assert 1 <= logged("start") <= 2
        assert vehicle.lost == 0


@pytest.mark.parametrize("executor", ["processes", "dask"])
@pytest.mark.parametrize("trouble", ["dies once", "kills worker"])
def test_a_run_that_is_lost_is_sent_again(executor, trouble):
    if executor == "dask":
        pytest.importorskip("distributed", reason="Dask, the extra 'cluster', is not installed")
    batches = np.arange(9.0, 24.0).reshape(3, 5)
    with named(trouble, executor=executor) as vehicle:
        for ranges in batches:  # all of them are pending when the worker is lost
            vehicle.begin(np.full(5, 20.0), ranges, np.ones(5))
        assert [run(vehicle, ranges).min_range.tolist() for ranges in batches] == (batches - 8).tolist()
        assert (vehicle.lost, len(vehicle.store)) == (1, 15)
        assert logged("run 11.0") == 2


@pytest.mark.parametrize("retries", [0, 1])
def test_an_encounter_that_always_fails_is_named(retries):
    where = "the encounter lead_speed 20, range 11, closing_speed 1: "
    with (
        named("dies always", retries=retries, batch_size=1) as vehicle,
        pytest.raises(InputError, match=f"{where}.*no licence.* outcomes are kept in"),
    ):
        run(vehicle, np.arange(9.0, 19.0))
    assert logged("run 11.0") == 1 + retries
