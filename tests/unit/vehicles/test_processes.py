"""Users' vehicles and campaigns as processes: none is left behind, ends in silence or loses results."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pandas as pd
import pytest
from accelerated_evaluation import InputError, cli, load_vehicle
from accelerated_evaluation.track.campaign_file import read_campaign
from law_folder import begin_campaign

CARS = """
import ctypes, faulthandler, time
import numpy as np
from accelerated_evaluation.vehicles import load_vehicle


class Segfault:
    def simulate(self, lead_speed, range_, closing_speed):
        faulthandler.disable()  # pytest would print the traceback of this intended death
        ctypes.string_at(0)


class Sleeping:
    def simulate(self, lead_speed, range_, closing_speed):
        time.sleep(600)


class Answer:
    crash, min_range, min_ttc, impact_speed = [[True], [False, True]], 1, 1, 1


class Ragged:
    def simulate(self, lead_speed, range_, closing_speed):
        return Answer()


class Raising:
    crash = property(lambda self: 1 / 0)

    def simulate(self, lead_speed, range_, closing_speed):
        return self
"""
WORKER = """
import signal

import numpy as np
from accelerated_evaluation.vehicles.external.workers import Processes, simulate_batch

if __name__ == "__main__":
    signal.signal(signal.SIGINT, signal.default_int_handler)  # shells ignore it for jobs in the background
    with Processes(1) as pool:
        future = pool.submit(simulate_batch, "cars.py:Sleeping", {}, np.ones((3, 2)), 300.0)
        while not pool._pools[0]._processes:
            pass
        print(*pool._pools[0]._processes, flush=True)
        future.result()
"""


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "cars.py").write_text(CARS)
    (tmp_path / "in.csv").write_text("lead_speed,range,closing_speed\n10,20,5\n10,10,9\n")
    return tmp_path


def ended(process, seconds=60):
    """Tell whether a process ends within some time; a zombie has ended."""
    deadline = time.monotonic() + seconds
    while time.monotonic() < deadline:
        try:
            if Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()[0] == "Z":
                return True
        except OSError:
            return True
        time.sleep(0.1)
    return False


@pytest.mark.parametrize(
    ("car", "reported"),
    [
        ("Segfault", "by SIGSEGV; expected outcomes"),
        ("Ragged", "crash: seen ValueError"),
        ("Raising", "crash: seen ZeroDivisionError: division by zero"),
    ],
)
def test_a_vehicle_that_fails_in_any_way_ends_with_a_message(car, reported, folder, capsys):
    assert cli.main(["simulate", "in.csv", "out.csv", "--vehicle", f"cars.py:{car}"]) != 0
    error = capsys.readouterr().err
    assert reported in error
    assert "Traceback" not in error
    assert not (folder / "out.csv").exists()


def test_a_worker_ends_with_a_killed_study_even_while_a_class_runs(folder):
    script = folder / "study.py"
    script.write_text(WORKER)
    study = subprocess.Popen([sys.executable, str(script)], cwd=folder, stdout=subprocess.PIPE, text=True)
    worker = int(study.stdout.readline())
    time.sleep(3)  # until the class sleeps; sooner, the worker would end in any case
    study.send_signal(signal.SIGKILL)
    study.wait()
    study.stdout.close()
    assert ended(worker)


@pytest.mark.parametrize("seconds", [0, 3])
def test_an_interrupt_at_the_keyboard_ends_workers_without_a_traceback(folder, seconds):
    """The keyboard interrupts the workers, too, while they start and while the vehicle runs."""
    script = folder / "study.py"
    # The interrupt may come as soon as the number of the process has been printed.
    watched = WORKER.replace("        print(*", "        try:\n            print(*")
    stopped = "    future.result()\n        except KeyboardInterrupt:\n            print('stopped')"
    script.write_text(watched.replace("future.result()", stopped))
    streams = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True}
    study = subprocess.Popen([sys.executable, str(script)], cwd=folder, start_new_session=True, **streams)
    worker = int(study.stdout.readline())
    time.sleep(seconds)
    os.killpg(study.pid, signal.SIGINT)
    assert study.communicate(timeout=60) == ("stopped\n", "")
    assert ended(worker)


def test_a_pipe_in_the_place_of_the_outcomes_is_refused(folder):
    program = folder / "pipe.py"
    program.write_text("import os, sys\nos.mkfifo(sys.argv[2])\n")
    car = load_vehicle("command", command=[sys.executable, str(program)])
    with pytest.raises(InputError, match=r"OUT\.csv: seen a folder, a device or a pipe"):
        car.simulate([10.0], [20.0], [5.0])


def test_results_that_are_told_at_the_same_instant_are_all_kept(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    begun = begin_campaign(tmp_path)
    assert begun("ask", "next", "--no-scenarios") == 0
    runs = pd.read_csv("next/runs.csv")
    line = [sys.executable, "-m", "accelerated_evaluation.cli", "campaign", "tell", "c.json"]
    tellers = []
    for row in range(3):
        runs.iloc[[row]].assign(crash=0).to_csv(f"reported{row}.csv", index=False)
        tellers.append(subprocess.Popen([*line, f"reported{row}.csv"], stdout=subprocess.DEVNULL))
    assert [teller.wait() for teller in tellers] == [0] * 3
    assert sum(run.outcome is not None for run in read_campaign("c.json").runs) == 3
