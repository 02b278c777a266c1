import argparse
import json
import os
import re
import shlex
import subprocess
import sys
from importlib.metadata import version
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest
from accelerated_evaluation import cli
from accelerated_evaluation.answer import estimation
from accelerated_evaluation.base.options import csv_file
from accelerated_evaluation.commands import COMMANDS
from accelerated_evaluation.scenarios.cut_in import CUT_IN
from accelerated_evaluation.vehicles import AccAeb

OUTCOMES = CUT_IN.outcome_names
HEADER = "lead_speed,range,closing_speed\n"
CAR = """
import numpy as np
from accelerated_evaluation.vehicles import Outcomes


class Ghost:
    def simulate(self, lead_speed, range_, closing_speed):
        never = np.zeros(len(range_), dtype=bool)
        return Outcomes(never, range_, np.full(len(range_), np.inf), closing_speed * never)


class Failing:
    def simulate(self, lead_speed, range_, closing_speed):
        raise RuntimeError("two\\nlines")
"""


@pytest.fixture
def table(tmp_path):
    """Write a table of cut-ins and return a function that simulates it in this process."""

    def simulate(text, *options):
        source, target = tmp_path / "in.csv", tmp_path / "out.csv"
        source.write_bytes(text if isinstance(text, bytes) else text.encode())
        return cli.main(["simulate", str(source), str(target), *options]), target

    return simulate


def test_every_published_verdict(tmp_path, stored):
    labels = stored("verdicts.parquet")
    labels.to_csv(tmp_path / "labels.csv", index=False)
    command = [sys.executable, "-m", "accelerated_evaluation.cli", "simulate", "labels.csv", "out.csv"]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert (done.returncode, done.stdout, done.stderr) == (0, "", "")
    out = pd.read_csv(tmp_path / "out.csv")
    assert list(out) == [*CUT_IN.names, "source", *OUTCOMES]
    assert (out.crash == labels.crash).sum() == 4695
    assert out[[*CUT_IN.names, "source"]].equals(labels[[*CUT_IN.names, "source"]])


def test_carries_columns_and_round_trips_outcomes(table):
    text = "\ufeffid,range, lead_speed ,crash,closing_speed,note\n" + "".join(
        f'00{i},{range_},20,old,{closing},"a, ""b"""\n'
        for i, (range_, closing) in enumerate(((1, 15), (50, 1e-3), (9, 0)))
    )
    status, target = table(text + "\n")
    assert status == 0
    out = pd.read_csv(target, dtype={"id": str})
    assert list(out) == ["id", "range", "lead_speed", "closing_speed", "note", *OUTCOMES]
    assert list(out.id) == ["000", "001", "002"]
    assert set(out.note) == {'a, "b"'}
    outcomes = AccAeb().simulate(out.lead_speed, out.range, out.closing_speed)
    for name in OUTCOMES:
        np.testing.assert_array_equal(out[name], getattr(outcomes, name))
    assert target.read_text().splitlines()[1].split(",")[6] == "1"


def test_output_may_replace_the_input(tmp_path):
    path = tmp_path / "table.csv"
    path.write_text(HEADER + "20,1,15\n")
    assert cli.main(["simulate", str(path), str(path)]) == 0
    once = path.read_bytes()
    assert cli.main(["simulate", str(path), str(path)]) == 0
    assert path.read_bytes() == once


def test_closing_speed_max(table):
    _, target = table(HEADER + "5,30,28\n5,30,23.49\n5,30,20\n", "--closing-speed-max", "23.49")
    out = pd.read_csv(target)
    assert list(out.closing_speed) == [28, 23.49, 20]
    assert out.loc[0, list(OUTCOMES)].equals(out.loc[1, list(OUTCOMES)])
    assert (out.loc[1, list(OUTCOMES)] != out.loc[2, list(OUTCOMES)]).any()
    _, target = table(HEADER + "5,30,28\n")
    assert pd.read_csv(target).impact_speed[0] > out.impact_speed[0]


def test_vehicles(table, tmp_path):
    (tmp_path / "car.py").write_text(CAR)
    crashes = {}
    for name in ("acc_aeb", "acc_only", f"{tmp_path}/car.py:Ghost"):
        status, target = table(HEADER + "20,2,15\n20,7.5,9\n", "--vehicle", name)
        assert status == 0
        crashes[name] = pd.read_csv(target).crash.tolist()
    assert list(crashes.values()) == [[1, 0], [1, 1], [0, 0]]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "No columns to parse from file"),
        (
            "lead_speed,range\n1,2\n",
            "column 'closing_speed': seen only the columns 'lead_speed', 'range'; expected a column of this",
        ),
        (HEADER.replace("range", "range,range") + "1,2,3,4\n", "column 'range' twice"),
        ("\0" * 5000, "column 'lead_speed': seen only the columns '\\x00"),
        (",".join(f"c{i}" for i in range(9999)) + "\n", "'c1', 'c2', 'c3', 'c4' and 9,994 more; expected"),
        (HEADER + "1_0,2,3\n", "row 2, column lead_speed: seen '1_0'; expected a finite number"),
        (HEADER + "1,2,3\n1,far,3\n", "row 3, column range: seen 'far'; expected a finite number"),
        (HEADER + "1,,3\n", "row 2, column range: seen ''; expected a finite number"),
        (HEADER + "1,2,3\n1,2,nan\n", "row 3, column closing_speed: seen 'nan'; expected a finite number"),
        (HEADER + "1,2,3\n1,-2,3\n", "row 3, column range: seen -2.0; expected a range above 0 m"),
        (HEADER + "-1,2,3\n", "row 2, column lead_speed: seen -1.0"),
        (HEADER + "1,2,3\n" * 5 + "1,2\n", "row 7, column closing_speed: seen ''; expected a finite number"),
        (HEADER + "1,2,3\n1,2,3,4\n", "Expected 3 fields in line 3, saw 4"),
        (HEADER.encode() + b"1,2,3\n1,2,\xff\n", "can't decode byte 0xff"),
    ],
)
def test_bad_tables(table, capsys, text, message):
    status, target = table(text)
    assert status == 2
    lines = capsys.readouterr().err.splitlines()
    assert len(lines) == 1
    assert lines[0].startswith(f"error: {target.with_name('in.csv')}")
    assert message in lines[0]
    assert [path.name for path in target.parent.iterdir()] == ["in.csv"]


def test_old_output_survives_an_error(table, tmp_path):
    (tmp_path / "out.csv").write_text("old")
    assert table(HEADER + "1,x,3\n")[0] == 2
    assert (tmp_path / "out.csv").read_text() == "old"


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (
            ["nowhere.csv", "out.csv"],
            "error: nowhere.csv: seen no such file; expected a file to read",
        ),
        (
            ["in.csv", "out.csv", "--vehicle", "acc"],
            "error: vehicle: seen 'acc'; expected acc_aeb, acc_only, ",
        ),
        (["in.csv", "out.csv", "--vehicle", "car.py:Failing"], "simulate: seen RuntimeError: two lines;"),
        (["in.csv", "in.csv/out.csv"], "a file stands where its folder should be"),
        (["in.csv", "out.parquet"], "error: OUT.csv: seen out.parquet; expected a name that ends in .csv"),
        (["in.csv", "x" * 300 + ".csv"], "cannot be written (File name too long)"),
        (["in.csv", "out.csv", *["--parameter", "headway=1"] * 2], "--parameter: seen headway twice"),
    ],
)
def test_bad_arguments(tmp_path, monkeypatch, capsys, arguments, message):
    monkeypatch.chdir(tmp_path)
    Path("in.csv").write_text(HEADER + "1,2,3\n")
    Path("car.py").write_text(CAR)
    assert cli.main(["simulate", *arguments]) == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert err.count("\n") == 1
    assert message in err
    assert not Path("out.csv").exists()


def test_all_numbers_of_commands_refuse_underscores_and_nan():
    def options(parser):
        for action in parser._actions:
            below = action.choices.values() if isinstance(action, argparse._SubParsersAction) else ()
            yield from ((parser, action), *(found for each in below for found in options(each)))

    texts, numbers = {None, Path, csv_file}, 0
    for parser, action in options(cli.parser()):
        if action.type in texts or isinstance(action, argparse._SubParsersAction):
            continue
        numbers += 1
        for text in ("1_0", "nan"):
            with pytest.raises(argparse.ArgumentError, match=f"seen '{text}'; expected"):
                parser._get_value(action, text)
    assert numbers > 15


@pytest.mark.parametrize(
    ("arguments", "where"),
    [
        (["replay", "20", "15", "6", "o.csv", "--vehicle", ""], "the argument after --vehicle"),
        (["replay", "20", "15", "6", "o.csv", "--vehicle="], "--vehicle"),
        (["compare", "", "spmd"], "the argument after compare"),
        (["simulate", "i.csv", "o.csv", "--scenario", " "], "the argument after --scenario"),
    ],
)
def test_an_empty_argument_is_no_default(tmp_path, monkeypatch, capsys, arguments, where):
    """An unset variable of the shell would otherwise choose the default, or the folder itself."""
    monkeypatch.chdir(tmp_path)
    assert cli.main(arguments) == 2
    assert capsys.readouterr().err.startswith(f"error: {where}: seen an empty text")
    assert not list(tmp_path.iterdir())


STEPS = [f"campaign {step}" for step in ("new", "ask", "tell", "status")]


@pytest.mark.parametrize("name", [*COMMANDS, *STEPS])
def test_help_of_a_subcommand_has_an_example_whose_options_exist(name, capsys):
    with pytest.raises(SystemExit):
        cli.main([*name.split(), "--help"])
    text = capsys.readouterr().out.replace("\\\n", " ")
    examples = re.findall(r"^  accelerated-evaluation (.*)", text, re.MULTILINE)
    assert any(example.startswith(f"{name} ") for example in examples)
    for example in examples:
        cli.parser().parse_args(shlex.split(example))


@pytest.mark.parametrize(
    ("line", "expected"),
    [
        ("accelerated-evaluation est", {"estimate"}),
        ("accelerated-evaluation campaign s", {"status"}),
        ("accelerated-evaluation estimate --ag", {"--against"}),
    ],
)
def test_the_shell_completes_subcommands_and_options(line, expected, tmp_path):
    found = tmp_path / "completions"
    asks = {
        "_ARGCOMPLETE": "1",
        "COMP_LINE": line,
        "COMP_POINT": str(len(line)),
        "_ARGCOMPLETE_SHELL": "bash",
    }
    asks |= {"_ARGCOMPLETE_STDOUT_FILENAME": str(found), "_ARGCOMPLETE_IFS": "\n"}
    subprocess.run(
        [sys.executable, "-m", "accelerated_evaluation.cli"], env=os.environ | asks, check=True, timeout=60
    )
    assert {word.strip() for word in found.read_text().split("\n")} == expected


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["--scenario", "left_turn", "--vehicle", "cc_human"], "a vehicle of the scenario cut_in; expected"),
        (
            ["--scenario=left_turn", "--vehicle=command", "--parameter=command=ls"],
            "column 'sdv_speed_mps': seen only the columns",
        ),
        (["--scenario", "left_trun"], "Did you mean left_turn"),
        (["--scenario", "pedestrian", "--closing-speed-max", "3"], "seen the scenario pedestrian; expected"),
    ],
)
def test_what_does_not_belong_to_a_scenario_is_named(table, capsys, options, message):
    assert table("lead_speed,range,closing_speed\n10,20,1\n", *options)[0] == 2
    assert message in capsys.readouterr().err


def test_encounters_of_any_scenario_are_simulated_by_a_user_s_class(table, tmp_path, capfd, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("car.py").write_text(TURNING)
    text = "distance_to_conflict_m,sdv_speed_mps,turning_speed_mps,crash,note\n50,10,6,1,a\n70,20,6,0,b\n"
    status, target = table(text, "--scenario", "left_turn", "--vehicle", "car.py:Turning")
    assert status == 0
    out = pd.read_csv(target)
    assert out["note"].tolist() == ["a", "b"]
    assert out["crash"].tolist() == [0, 1]
    assert out["ended"].tolist() == [0, 1]
    assert out["min_distance"].tolist() == [40, 50]
    assert "1 run did not end" in capfd.readouterr().err
    outside = text.replace("50,10", "50,99")
    assert table(outside, "--scenario", "left_turn", "--vehicle", "car.py:Turning")[0] == 2
    assert "row 2, column sdv_speed_mps: seen 99.0; expected 0 to 35 m/s" in capfd.readouterr().err


def test_what_a_vehicle_prints_is_not_part_of_the_answer(monkeypatch, capfd, tmp_path):
    def estimated(config, request):
        print("from the vehicle")
        subprocess.run([sys.executable, "-c", "print('from a worker')"], check=True)
        answer = {"answer": []}
        return SimpleNamespace(write=lambda folder: None, content=lambda compared: answer, tables={})

    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(estimation, "estimate_event", estimated)
    assert cli.main(["estimate", "--scenario", "left_turn", "--json"]) == 0
    found = capfd.readouterr()
    assert json.loads(found.out) == {"answer": []}
    assert "from the vehicle" in found.err
    assert "from a worker" in found.err


def test_another_vehicle_is_named_by_its_configuration(monkeypatch, capsys, tmp_path):
    asked = []

    def estimated(settings, request):
        asked.append((settings.against.parameters, request.against, settings.criteria[0].reference))
        return SimpleNamespace(write=lambda folder: None, content=lambda compared: {}, tables={})

    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(estimation, "estimate_event", estimated)
    Path("old-2.yaml").write_text("vehicle: {name: acc_aeb, parameters: {aeb: false}}\n")
    options = ["--scenario", "left_turn", "--json", "--against", "old-2.yaml"]
    assert cli.main(["estimate", *options, "--criterion", "1 x old_2"]) == 0
    assert asked == [({"aeb": False}, "old_2", "old_2")]
    assert cli.main(["estimate", *options, "--criterion", "1 x other"]) == 2
    assert "--reference: seen 'other'; expected one of acc_aeb" in capsys.readouterr().err


TURNING = """
from types import SimpleNamespace
import numpy as np
class Turning:
    def simulate(self, speed, turning_speed, distance):
        far = distance - speed
        names = [each for each in SCENARIO.outcome_names if each not in ("crash", "ended")]
        numbers = dict.fromkeys(names, far)
        numbers["clearance"] = np.where(speed > 15, -1.0, far)
        numbers["impact_speed"] = np.where(speed > 15, speed, 0.0)
        return SimpleNamespace(crash=speed > 15, ended=speed > 15, **numbers)
from accelerated_evaluation.scenarios.left_turn import LEFT_TURN as SCENARIO
"""


def test_a_command_loads_neither_optional_libraries_nor_those_for_figures():
    """All commands are imported for the help of each, also where `rocrate` is not installed."""
    code = "import sys, accelerated_evaluation.commands as of; list(of.COMMANDS); print(*sys.modules)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    loaded = done.stdout.split()
    assert "accelerated_evaluation.commands.crate" in loaded
    assert not {"rocrate", "matplotlib", "accelerated_evaluation.publishing"} & set(loaded)


def test_the_version_is_that_of_the_package(capsys):
    with pytest.raises(SystemExit) as ended:
        cli.main(["--version"])
    assert ended.value.code == 0
    assert capsys.readouterr().out == f"accelerated-evaluation {version('accelerated-evaluation')}\n"


BAR = """
import sys
from types import SimpleNamespace
from accelerated_evaluation import cli

def run(arguments):
    from tqdm import tqdm
    list(tqdm([1], desc="a bar"))

toy = SimpleNamespace(help="toy", description="Toy.", add_arguments=lambda command: None, run=run)
cli.COMMANDS = {"toy": toy}
sys.argv = ["accelerated-evaluation", "toy"]
"""


@pytest.mark.parametrize(("call", "bars"), [("cli.main()", 0), ("run(None)", 1)])
def test_a_log_contains_no_progress_bars(call, bars):
    code = f"{BAR}\n{call}"
    environment = {name: value for name, value in os.environ.items() if not name.startswith("TQDM")}
    done = subprocess.run(
        [sys.executable, "-c", code], check=True, capture_output=True, text=True, env=environment
    )
    assert ("a bar" in done.stderr) == bool(bars)


@pytest.mark.parametrize(
    "other",
    [
        {"scenario": "left_turn", "name": "acc_aeb", "parameters": {"a": 1}},
        {"scenario": "pedestrian", "name": "acc_aeb", "parameters": {}},
        {"scenario": "left_turn", "name": "mine.py:Car", "parameters": {}},
    ],
)
def test_an_estimate_does_not_replace_that_of_another_vehicle(tmp_path, monkeypatch, capsys, other):
    monkeypatch.chdir(tmp_path)
    folder = tmp_path / "results/left_turn/estimate"
    folder.mkdir(parents=True)
    (folder / "vehicle.json").write_text(json.dumps(other, indent=1))
    assert cli.main(["estimate", "--scenario", "left_turn"]) == 2
    reported = capsys.readouterr().err
    assert reported.startswith("error: results/left_turn/estimate: seen the estimate of another vehicle: {")
    assert "Give this vehicle a study of its own, with the key study." in reported
    assert [path.name for path in folder.iterdir()] == ["vehicle.json"]
