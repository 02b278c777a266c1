"""Slow vehicles: nothing is simulated twice, and what was simulated before a fault is kept."""

from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from accelerated_evaluation import InputError, load_vehicle
from accelerated_evaluation.scenarios.cut_in import CUT_IN
from accelerated_evaluation.scenarios.outcomes import have_failed
from accelerated_evaluation.vehicles.external.checked import CheckedVehicle
from accelerated_evaluation.vehicles.external.slow import SlowVehicle
from accelerated_evaluation.vehicles.external.store import Store, store_of
from accelerated_evaluation.vehicles.external.workers import Cluster, Processes, Workers, workers_of
from accelerated_evaluation.vehicles.named import NamedVehicle

CAR = """
import os
import signal
import time

import numpy as np
from accelerated_evaluation.vehicles import Outcomes


class Car:
    # Keeps its speed for 8 s, notes what it simulates, and misbehaves where reported.
    def __init__(self, log, trouble="none", at=0.0, seconds=0.0):
        self.log, self.trouble, self.at, self.seconds = log, trouble, at, seconds

    def simulate(self, lead_speed, range_, closing_speed):
        print("a line that nobody asked for")
        with open(self.log, "a") as log:
            for encounter in range_:
                time.sleep(self.seconds)
                log.write(f"{encounter}\\n")
                log.flush()
        if self.at in range_ and self.trouble == "fails":
            raise RuntimeError("no licence")
        if self.at in range_ and self.trouble == "exits":
            os.kill(os.getpid(), signal.SIGKILL)
        if self.at in range_ and self.trouble == "hangs":
            time.sleep(600)
        last = range_ - np.maximum(closing_speed, 0) * 8
        noise = np.random.default_rng().random(len(range_)) if self.trouble == "random" else 0
        ttc = np.maximum(last, 0.01) / closing_speed + noise
        return Outcomes(last <= 0, last, ttc, np.where(last <= 0, closing_speed, 0))
"""
SIMULATIONS = {
    "keep_class": True,
    "batch_size": 100,
    "time_limit": 60.0,
    "executor": "processes",
    "workers": 2,
    "options": {},
}
RANGES = np.arange(10.0, 22.0)


@pytest.fixture
def here(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("car.py").write_text(CAR)
    return tmp_path


def vehicle_section(**parameters):
    return {"name": "car.py:Car", "parameters": {"log": "log", **parameters}, "files": []}


def loaded(section, **changes):
    return NamedVehicle.of(section, SIMULATIONS, CUT_IN, **changes).loaded()


def slow(workers, batch_size=3, time_limit=60.0, retries=2, *, sets_aside=False, **parameters):
    """Return the car with its store, on given workers."""
    section = vehicle_section(**parameters)
    store = store_of("car.py:Car", section["parameters"], ["car.py"], CUT_IN)
    limits = {
        "batch_size": batch_size,
        "time_limit": time_limit,
        "retries": retries,
        "sets_aside": sets_aside,
    }
    return SlowVehicle("car.py:Car", section["parameters"], "car.py:Car", store, workers, CUT_IN, **limits)


@pytest.fixture
def threads():
    with ThreadPoolExecutor(2) as pool:
        yield Workers(pool, pool, 2)


def run(vehicle, ranges=RANGES):
    return vehicle.simulate(np.full(len(ranges), 20.0), ranges, np.full(len(ranges), 2.0))


def logged():
    return [float(line) for line in Path("log").read_text().split()] if Path("log").exists() else []


def columns(outcomes):
    return [getattr(outcomes, name).tolist() for name in CUT_IN.outcome_names]


def test_nothing_is_simulated_twice(here, threads, capfd):
    first = slow(threads)
    outcomes = run(first)
    assert "a line that nobody asked for" not in capfd.readouterr().out
    assert columns(outcomes) == columns(run(load_vehicle("car.py:Car", log="other")))
    # Eight of them are simulated again, to see whether the car is deterministic.
    assert first.simulated == len(logged()) == 12 + 8
    assert columns(run(first)) == columns(outcomes)
    again = slow(threads)
    twice = np.concatenate([RANGES[::-1], RANGES[:2], [30.0, 30.0]])
    assert run(again, twice).min_range.tolist() == (twice - 16).tolist()
    assert (again.simulated, again.found, len(again.store)) == (1, 12, 13)
    assert logged()[20:] == [30.0]
    assert run(again, np.empty(0)).crash.shape == (0,)


def test_a_fault_keeps_what_other_batches_gave(here, threads):
    broken = slow(threads, trouble="fails", at=15.0)
    message = (
        "vehicle car.py:Car, simulate, the encounter lead_speed 20, range 15, closing_speed 2: "
        r"seen RuntimeError: no licence; .* ([5-9]|1[01]) outcomes are kept in .*outcomes.sqlite"
    )
    with pytest.raises(InputError, match=message):
        run(broken)
    assert broken.lost == broken.retries == logged().count(15.0) - 1
    kept = len(broken.store)
    with pytest.raises(InputError, match="no licence"):
        run(slow(threads, batch_size=1, retries=0, trouble="fails", at=15.0))
    assert 5 <= kept <= len(broken.store) < 12


def test_a_run_that_fails_again_and_again_is_set_aside(here, threads):
    """With another failed run among fewer than ten others, the vehicle is at fault."""
    broken = slow(threads, retries=1, sets_aside=True, trouble="fails", at=15.0)
    found, known = run(broken), RANGES != 15.0
    assert have_failed(found).tolist() == (~known).tolist()
    assert found.min_range[known].tolist() == (RANGES[known] - 16).tolist()
    assert (len(broken.failed), len(broken.store)) == (1, 11)
    tries = logged().count(15.0)
    assert run(broken, RANGES[4:6]).crash.tolist() == [True, False]
    assert logged().count(15.0) == tries  # it is not tried once more
    with pytest.raises(InputError, match=r"no licence; 4 of 16 runs have failed.* 11 outcomes are kept"):
        run(broken, RANGES[[5, 5]])


def test_encounters_that_were_begun_are_simulated_once_whatever_ends_first(here, threads):
    """Batches that are begun are run while an earlier one is awaited; random outcomes keep their numbers."""
    cut_ins = np.full(12, 20.0), RANGES, np.full(12, 2.0)
    car, other = slow(threads, 1, trouble="random"), slow(threads, 1, trouble="random")
    for each in (car, other):
        each.deterministic = False
    for part in (slice(0, 4), slice(4, 12)):
        car.begin(*(column[part] for column in cut_ins))
    car.begin(*(column[:2] for column in cut_ins), again=True)
    found = run(car, RANGES[:4]).min_ttc, run(car, RANGES[4:]).min_ttc
    again = car.repeat(*(column[:2] for column in cut_ins)).min_ttc
    assert car.simulated == len(logged()) == 14
    assert run(other).min_ttc.tolist() == np.concatenate(found).tolist()
    assert run(other, RANGES[:2]).min_ttc.tolist() == again.tolist()  # the second outcomes of the store
    assert other.simulated == 0


def test_a_car_that_is_not_deterministic_is_noticed_once_and_remembered(here, threads):
    car = slow(threads, trouble="random")
    with pytest.warns(UserWarning, match=r"min_ttc of the encounter .* when simulated again"):
        run(car)
    assert car.deterministic is False
    assert slow(threads, trouble="random").deterministic is False


def test_a_car_that_contradicts_its_declaration_is_refused(here, threads):
    car = slow(threads, trouble="random")
    car.deterministic = True
    with pytest.raises(InputError, match=r"min_ttc of the encounter .* when simulated again"):
        run(car)


def test_every_outcome_of_a_car_with_chance_is_kept_with_its_number(here, threads):
    car = slow(threads, trouble="random")
    car.deterministic = False
    times = [run(car, RANGES[[0, 0, 1]]).min_ttc, run(car, RANGES[[0, 0, 1]]).min_ttc]
    assert len(np.unique(times)) == 6
    assert (car.simulated, car.found) == (6, 0)
    again = slow(threads, trouble="random")
    again.deterministic = False
    for first in times:  # asked in the same order, the store gives the same outcomes
        np.testing.assert_array_equal(run(again, RANGES[[0, 0, 1]]).min_ttc, first)
    assert (again.simulated, again.found) == (0, 6)
    assert run(again, RANGES[:1]).min_ttc[0] not in np.ravel(times)


def test_a_repeat_is_simulated_again_and_kept(here, threads):
    car = slow(threads, trouble="random")
    car.store.set_verdict(deterministic=True)
    first = run(car).min_ttc
    np.testing.assert_array_equal(run(car).min_ttc, first)
    cut_ins = np.full(12, 20.0), RANGES, np.full(12, 2.0)
    assert (car.repeat(*cut_ins).min_ttc != first).all()
    assert car.simulated == 24


@pytest.mark.parametrize(("trouble", "limit"), [("exits", 60.0), ("hangs", 2.0)])
def test_a_car_that_hangs_or_ends_its_process(here, trouble, limit):
    seen = {
        "exits": "seen the end of all 3 processes that simulated it; expected outcomes",
        "hangs": "seen no end after 2 s; expected outcomes within this time limit of a batch",
    }[trouble]
    with Processes(2) as processes:
        car = slow(
            Workers(processes, processes, 2),
            1,
            30.0 if trouble == "exits" else limit,
            trouble=trouble,
            at=11.0,
        )
        # A process needs its time to start, which counts; so the first run only starts them.
        car.time_limit = 60.0
        run(car, RANGES[2:4])
        car.time_limit = limit
        place = "the encounter lead_speed 20, range 11, closing_speed 2: "
        with pytest.raises(InputError, match=f"vehicle car.py:Car, {place}{seen}.* 3 outcomes are kept"):
            run(car, RANGES[:2])


def test_what_a_vehicle_is_names_its_store(here):
    def folder(name="car.py:Car", files=("car.py",), **parameters):
        return store_of(name, parameters, files, CUT_IN).path.parent

    one = folder(a=1)
    assert folder(a=1) == one
    assert one.parent == Path("results/vehicles")
    assert one.name.startswith("Car-")
    assert folder(a=2) != one
    assert folder("car.py:Other", a=1) != one
    Path("more.csv").write_text("1")
    more = folder(files=("car.py", "more.csv"), a=1)
    assert more != one
    Path("more.csv").write_text("2")
    assert folder(files=("car.py", "more.csv"), a=1) not in (one, more)
    Path("car.py").write_text(CAR + "\n")
    assert folder(a=1) != one


def test_a_store_gives_back_the_same_numbers(tmp_path):
    requests = [((0.1, 1 / 3, -5e-324), 0), ((1e308, 2.0, 0.0), 0), ((1e308, 2.0, 0.0), 3)]
    outcomes = [(1.0, -1 / 3, np.inf, 1e-300), (0.0, 5.0, 0.1, 0.0), (0.0, 6.0, 0.2, 0.0)]
    store = Store(tmp_path / "new" / "outcomes.sqlite", CUT_IN)
    store.add(requests, outcomes)
    store.add([requests[0], requests[2]], [(0.0, 0.0, 0.0, 0.0)] * 2)  # the first ones stay
    unknown = [((1.0, 1.0, 1.0), 0), ((1e308, 2.0, 0.0), 1)]
    assert Store(store.path, CUT_IN).known([*requests, *unknown]) == dict(
        zip(requests, outcomes, strict=True)
    )
    assert len(store) == 2


def test_a_store_that_cannot_be_used(tmp_path):
    path = tmp_path / "outcomes.sqlite"
    path.write_bytes(b"no database at all" * 100)
    with pytest.raises(InputError, match=r"outcomes.sqlite: seen file is not a database; expected a store"):
        Store(path, CUT_IN)


def test_which_vehicles_are_slow(here):
    with loaded({"name": "acc_aeb", "parameters": {}, "files": []}) as car:
        assert car == load_vehicle("acc_aeb")
    with loaded(vehicle_section(), keep_class=False) as car:
        assert isinstance(car, CheckedVehicle)
    assert not Path("results").exists()
    with loaded(vehicle_section()) as car:
        assert isinstance(car, SlowVehicle)
    command = {"name": "command", "parameters": {"command": "python car.py"}, "files": []}
    with loaded(command, keep_class=False) as car:
        assert isinstance(car, SlowVehicle)
        assert car.title == "python car.py"
    with (
        pytest.raises(InputError, match="unexpected keyword argument"),
        loaded(vehicle_section(b=1)),
    ):
        pass


def test_the_files_of_a_vehicle(here):
    """They are those that define it and those that its section lists; a built-in vehicle has none."""

    def files(name, listed=(), **parameters):
        section = {"name": name, "parameters": parameters, "files": list(listed)}
        return NamedVehicle.of(section, SIMULATIONS, CUT_IN).files

    Path("more.csv").write_text("1")
    assert files("acc_aeb") == []
    assert files("acc_aeb", ["more.csv"]) == ["more.csv"]
    assert files("car.py:Car", ["more.csv"], log="log") == ["car.py", "more.csv"]
    assert files("command", ["more.csv"], command="python car.py") == ["car.py", "more.csv"]


@pytest.mark.parametrize(
    ("executor", "options", "message"),
    [
        ("proceses", {}, "executor: seen 'proceses'; expected processes, dask, slurm, or the address"),
        ("tcp://127.0.0.1:9", {"timeout": 0.2}, "simulations, 'tcp://127.*9': seen .*expected a cluster"),
        ("dask", {"processes": False, "no_such_option": 1}, "simulations, 'dask': seen TypeError"),
        ("slurm", {}, "simulations, 'slurm': seen (no program sbatch|sbatch: )"),
    ],
)
def test_executors_that_cannot_be_used(monkeypatch, tmp_path, executor, options, message):
    if executor != "proceses":
        pytest.importorskip("dask_jobqueue", reason="Dask, the extra 'cluster', is not installed")
    # Where Slurm is installed, it refuses at once; without a file it would look for a cluster for a minute.
    (tmp_path / "slurm.conf").write_text("nonsense\n")
    monkeypatch.setenv("SLURM_CONF", str(tmp_path / "slurm.conf"))
    with pytest.raises(InputError, match=message), workers_of(executor, 2, options):
        pass


def test_a_call_whose_result_is_lost_on_a_cluster_ends_with_its_error():
    """A worker may die after the call, before its result is fetched; nothing waits for it forever."""
    task = SimpleNamespace(add_done_callback=lambda pass_on: pass_on(task))
    cluster = Cluster(SimpleNamespace(submit=lambda *_, **__: task))
    with pytest.raises(AttributeError, match="result"):
        cluster.submit(run).result(timeout=10)


def test_a_dask_cluster_gives_the_same(here):
    pytest.importorskip("distributed", reason="Dask, the extra 'cluster', is not installed")
    dask = {"executor": "dask", "options": {"processes": False}, "batch_size": 2}
    with loaded(vehicle_section(), **dask) as car:
        assert columns(run(car)) == columns(run(load_vehicle("car.py:Car", log="other")))
        assert car.simulated == 20
    with loaded(vehicle_section(trouble="fails", at=11.0), **dask) as car:
        with pytest.raises(InputError, match="no licence"):
            run(car)
        assert len(car.store) > 0
