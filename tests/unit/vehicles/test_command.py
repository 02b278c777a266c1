"""A vehicle that is a command: its contract, and every way to break it."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from accelerated_evaluation import InputError, cli, load_vehicle
from accelerated_evaluation.scenarios.cut_in import CUT_IN

# A host that keeps its speed for 8 s, in the standard library alone, so that it starts quickly.
PROGRAM = """
import csv, os, signal, subprocess, sys, time

trouble, source, target = sys.argv[1:]
rows = list(csv.DictReader(open(source)))
table = []
for row in rows:
    closing, start = float(row["closing_speed"]), float(row["range"])
    last = start - max(closing, 0) * 8
    ttc = max(last, 0.01) / closing if closing > 0 else float("inf")
    table.append([int(last <= 0), last, ttc, closing * (last <= 0)])
header = ["crash", "min_range", "min_ttc", "impact_speed"]
if trouble == "words":
    table = [["True" if line[0] else "False", *line[1:], "more"] for line in table]
    header = [*header, "note"]
if trouble == "prints":
    print("a long line\\n" * 200_000, file=sys.stderr)
if trouble == "fails":
    sys.exit("no licence\\nfor this tool")
if trouble == "killed":
    os.kill(os.getpid(), signal.SIGKILL)
if trouble == "hangs":
    print("waiting for a licence", flush=True)
    subprocess.run(["sleep", "60"])
if trouble == "nothing":
    sys.exit()
if trouble == "short":
    table.pop()
if trouble == "column":
    header[2] = "ttc"
if trouble == "text":
    table[1][1] = "much"
if trouble == "flag":
    table[1][0] = "2"
if trouble == "missing":
    table[1] = table[1][:2]
if trouble == "long":
    table[0][1:2] = ["1", "5"]  # a decimal comma
if trouble == "nan":
    table[1][1] = float("nan")
if trouble == "random":
    table[0][2] += os.getpid() + time.time() % 1
if trouble == "bytes":
    open(target, "wb").write(b"crash,min_range\\n\\xff\\xfe")
elif trouble == "empty":
    open(target, "w")
else:
    csv.writer(open(target, "w")).writerows([header, *table])
"""
ENCOUNTERS = [[20.0, 20.0], [10.0, 10.0], [5.0, 1.0]]


@pytest.fixture
def program(tmp_path):
    (tmp_path / "car.py").write_text(PROGRAM)
    return lambda trouble: [sys.executable, str(tmp_path / "car.py"), trouble]


@pytest.mark.parametrize("trouble", ["none", "words", "prints"])
def test_a_command_is_a_vehicle(program, trouble):
    vehicle = load_vehicle("command", command=program(trouble))
    outcomes = vehicle.simulate(*ENCOUNTERS)
    assert outcomes.crash.tolist() == [True, False]
    assert outcomes.min_range.tolist() == [-30.0, 2.0]
    assert outcomes.min_ttc.tolist() == [0.002, 2.0]
    assert outcomes.impact_speed.tolist() == [5.0, 0.0]
    assert vehicle.simulate([], [], []).crash.shape == (0,)


def test_the_study_s_own_command_is_one_too():
    own = load_vehicle("command", command=f"{sys.executable} -m accelerated_evaluation.cli simulate")
    numbers = np.random.default_rng(1).uniform([[5], [1], [0]], [[20], [30], [18]], (3, 40))
    got, wanted = own.simulate(*numbers), load_vehicle("acc_aeb").simulate(*numbers)
    for name in CUT_IN.outcome_names:
        assert getattr(got, name).tolist() == getattr(wanted, name).tolist()


@pytest.mark.parametrize(
    ("trouble", "message"),
    [
        ("fails", r"a batch of 2 encounters \(lead_speed 20, range 10, closing_speed 5; lead_speed 20, .*\): "
                  "seen exit status 1, and printed last 'for this tool'; expected exit status 0"),
        ("killed", "seen killed by SIGKILL"),
        ("nothing", "seen no file OUT.csv; expected the outcomes in it"),
        ("empty", "OUT.csv, row 1: seen no header; expected the columns crash, "),
        ("column", "OUT.csv, row 1: seen crash, min_range, ttc, impact_speed; expected the columns crash"),
        ("short", "OUT.csv: seen 1 rows; expected 2, one for each row of IN.csv"),
        ("text", "OUT.csv, row 3, column min_range, the encounter lead_speed 20, range 10, closing_speed 1: "
                 "seen 'much'; expected a number"),
        ("flag", "OUT.csv, row 3, column crash, .*: seen '2'; expected 0 or 1"),
        ("long", r"OUT\.csv, row 2: seen \d cells; expected \d, as in the header"),
        ("missing", "OUT.csv, row 3, column min_ttc, .*: seen ''; expected a number"),
        ("nan", r"min_range\[1\] of the encounter lead_speed 20, range 10, closing_speed 1: seen nan"),
        ("bytes", "OUT.csv: seen 'utf-8' codec"),
    ],
)  # fmt: skip
def test_commands_that_break_the_contract(program, trouble, message):
    with pytest.raises(InputError, match=f"vehicle .*car.py {trouble}, .*{message}"):
        load_vehicle("command", command=program(trouble)).simulate(*ENCOUNTERS)


def test_a_command_that_hangs_is_ended_with_all_that_it_started(program):
    vehicle = load_vehicle("command", command=program("hangs"))
    vehicle.vehicle.time_limit = 1.0
    begun = time.monotonic()
    with pytest.raises(InputError, match="seen no end after 1 s, and printed last 'waiting for a licence'"):
        vehicle.simulate(*ENCOUNTERS)
    assert time.monotonic() - begun < 50  # the sleep of its child would last longer
    mine = os.popen("ps -o args= --ppid 1").read()
    assert "sleep 60" not in mine


@pytest.mark.parametrize(
    ("parameters", "message"),
    [
        ({}, "vehicle command: seen no parameter 'command'"),
        ({"command": ""}, "vehicle parameter command: seen ''; expected a program and its arguments"),
        ({"command": []}, "expected a program and its arguments"),
        ({"command": 3}, "seen 3; expected text or a list, each of it text"),
        ({"command": ["ls", 3]}, "expected text or a list, each of it text"),
        ({"command": "ls 'a"}, r"expected words as in a shell \(No closing quotation\)"),
        ({"command": "ls", "time": 3}, "parameter 'time'"),
    ],
)
def test_commands_that_cannot_be_used(parameters, message):
    with pytest.raises(InputError, match=message):
        load_vehicle("command", **parameters)


@pytest.mark.parametrize(
    ("word", "message"),
    [("no-such-program-here", "no such file or directory"), ("{folder}/car.py", "permission denied")],
)
def test_programs_that_do_not_start(program, tmp_path, word, message):
    word = word.format(folder=tmp_path)
    with pytest.raises(InputError, match=f"start: seen '{word}': {message}; expected a program"):
        load_vehicle("command", command=[word]).simulate(*ENCOUNTERS)


def test_simulate_takes_parameters(program, tmp_path, capsys):
    (tmp_path / "in.csv").write_text("lead_speed,range,closing_speed\n20,10,5\n20,10,1\n")
    files = [str(tmp_path / "in.csv"), str(tmp_path / "out.csv")]
    words = str(program("none")).replace("'", '"')
    options = ["--vehicle", "command", "--parameter", f"command={words}"]
    assert cli.main(["simulate", *files, *options]) == 0
    assert (tmp_path / "out.csv").read_text().splitlines()[1] == "20,10,5,1,-30.0,0.002,5.0"
    assert cli.main(["simulate", *files, "--parameter", "aeb_jerk=12"]) == 0
    for option, message in [
        ("aeb_jerk", "--parameter: seen 'aeb_jerk'; expected NAME=VALUE"),
        ("aeb_jerk=[1", "--parameter aeb_jerk: seen '[1'; expected a value as in YAML"),
        ("aeb_jrk=1", "parameter 'aeb_jrk'"),
    ]:
        assert cli.main(["simulate", *files, "--parameter", option]) == 2
        assert message in capsys.readouterr().err


COUNTED = """
import csv, sys

source, target = sys.argv[1:]
rows = list(csv.DictReader(open(source)))
with open("runs.txt", "a") as runs:
    runs.write("run\\n" * len(rows))
table = [[0, float(row["range"]), 5.0, 0.0] for row in rows]
csv.writer(open(target, "w")).writerows([["crash", "min_range", "min_ttc", "impact_speed"], *table])
"""


def test_simulate_runs_a_program_once_for_each_new_row_and_again_only_if_asked(tmp_path, monkeypatch, capsys):
    """1 row is 1 run, 10 rows are 10 runs, and the same rows again are none."""
    monkeypatch.chdir(tmp_path)
    Path("program.py").write_text(COUNTED)
    command = ["--vehicle", "command", "--parameter", f"command={sys.executable} program.py"]

    def runs(rows, *options):
        lines = [f"20,{10 + row},2" for row in rows]
        Path("in.csv").write_text("\n".join(["lead_speed,range,closing_speed", *lines]) + "\n")
        Path("runs.txt").write_text("")
        assert cli.main(["simulate", "in.csv", "out.csv", *command, *options]) == 0
        assert pd.read_csv("out.csv")["min_range"].tolist() == [10.0 + row for row in rows]
        return len(Path("runs.txt").read_text().split())

    assert runs([0]) == 1
    assert runs(range(1, 11)) == 10
    assert runs(range(11)) == 0
    assert runs([3, 3, 20, 20]) == 1
    assert "1 encounters simulated, 1 taken from results/vehicles/command-" in capsys.readouterr().out
    assert runs(range(11), "--again") == 11
    Path("program.py").write_text(COUNTED + "# another version\n")
    assert runs(range(11), "--workers", "2", "--batch-size", "3") == 11


def test_simulate_runs_a_class_once_for_each_row(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("car.py").write_text(
        "from pathlib import Path\nfrom accelerated_evaluation import load_vehicle\n\n\n"
        "class Car:\n    def simulate(self, *columns):\n"
        "        with open('runs.txt', 'a') as runs:\n            runs.write('run\\n' * len(columns[0]))\n"
        "        return load_vehicle('acc_aeb').simulate(*columns)\n"
    )
    Path("in.csv").write_text("lead_speed,range,closing_speed\n20,10,5\n20,12,5\n20,14,5\n")
    for options, wanted in (([], 3), ([], 3), (["--keep"], 3), (["--keep"], 0)):
        Path("runs.txt").write_text("")
        assert cli.main(["simulate", "in.csv", "out.csv", "--vehicle", "car.py:Car", *options]) == 0
        assert len(Path("runs.txt").read_text().split()) == wanted


def test_an_interrupt_says_what_is_kept_and_leaves_no_worker(tmp_path):
    (tmp_path / "program.py").write_text(COUNTED.replace("import csv, sys", "import csv, sys, time") + SLOW)
    lines = [f"20,{10 + row},2" for row in range(6)]
    (tmp_path / "in.csv").write_text("\n".join(["lead_speed,range,closing_speed", *lines]) + "\n")
    command = [sys.executable, "-m", "accelerated_evaluation.cli", "simulate", "in.csv", "out.csv"]
    command += ["--vehicle", "command", "--parameter", f"command={sys.executable} program.py"]
    started = subprocess.Popen(
        [*command, "--batch-size", "1"],
        cwd=tmp_path,
        stderr=subprocess.PIPE,
        text=True,
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.default_int_handler),
    )
    while not (tmp_path / "slow.txt").exists():  # the third run is under way
        time.sleep(0.05)
        assert started.poll() is None
    worker = int((tmp_path / "slow.txt").read_text())
    started.send_signal(signal.SIGINT)  # to the command alone; a terminal would interrupt all
    assert "2 outcomes are kept in results/vehicles/command-" in started.communicate(timeout=30)[1]
    assert started.returncode == 130
    deadline = time.monotonic() + 20  # its parent is gone, so that another process has to collect it
    while is_running(worker):
        assert time.monotonic() < deadline
        time.sleep(0.05)
    assert not (tmp_path / "out.csv").exists()


def is_running(pid):
    """Return whether a process runs; one that has ended may still be listed until it is collected."""
    try:
        os.kill(pid, 0)
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except (ProcessLookupError, FileNotFoundError):
        return False


SLOW = """
import os
if float(rows[0]["range"]) == 12:
    with open("now.txt", "w") as file:
        file.write(str(os.getpid()))
    os.rename("now.txt", "slow.txt")
    time.sleep(600)
"""
