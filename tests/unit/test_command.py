"""A vehicle that is a command: its contract, and every way to break it."""

import os
import sys
import time

import numpy as np
import pytest
from accelerated_evaluation import InputError, cli, load_vehicle
from accelerated_evaluation.vehicles.protocol import OUTCOMES

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
    for name in OUTCOMES:
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
        ({"command": 3}, "seen 3; expected a text, or a list of texts"),
        ({"command": ["ls", 3]}, "expected a text, or a list of texts"),
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
