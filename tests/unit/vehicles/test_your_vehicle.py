"""The guides to vehicles: each of its three examples is run as it stands, on fewer records."""

import re
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from accelerated_evaluation import cli, load_vehicle
from accelerated_evaluation.scenarios.cut_in import CUT_IN
from accelerated_evaluation.study.configuration import load, read_yaml
from guide_files import clone_of, files_in, text_of

GUIDE = text_of("your_vehicle", "vehicle_reference", "staying_program")
BLOCKS = re.findall(r"^```(\w*)\n(.*?)^```$", GUIDE, re.DOTALL | re.MULTILINE)
COMMANDS = [content for language, content in BLOCKS if not language]
FILES = files_in(GUIDE)
clone = clone_of(FILES)


def require(kind):
    if kind == "fmu":
        pytest.importorskip("fmpy", reason="FMPy, the extra 'fmu', is not installed")
        if shutil.which("cc") is None:
            pytest.skip("no C compiler is here to make the FMU")
        make = next(block for block in COMMANDS if block.startswith("mkdir -p binaries"))
        python = f"PATH={Path(sys.executable).parent}:$PATH\n"
        subprocess.run(["sh", "-e", "-c", python + make], check=True)
    if kind == "staying":
        if shutil.which("c++") is None:
            pytest.skip("no C++ compiler is here to make the program")
        make = next(block for block in COMMANDS if block.startswith("c++ ")).splitlines()[0]
        subprocess.run(make.split(), check=True)
    if kind == "command" and shutil.which("awk") is None:
        pytest.skip("no awk is here")


def loaded(kind):
    section = read_yaml(Path(f"my_{kind}.yaml"))["vehicle"]
    return load_vehicle(section["name"], **section["parameters"])


@pytest.mark.parametrize("kind", ["command", "staying", "staying in Python", "fmu"])
def test_the_examples_are_the_same_car(clone, kind):
    if kind == "staying in Python":
        kind, example = "staying", Path("my_staying.yaml")
        example.write_text(example.read_text().replace("./my_staying", f"[{sys.executable}, my_staying.py]"))
    else:
        require(kind)
    generator = np.random.default_rng(3)
    numbers = generator.uniform(12, 20, 60), generator.uniform(1, 30, 60), generator.uniform(-2, 11, 60)
    own, wanted = loaded(kind).simulate(*numbers), loaded("class").simulate(*numbers)
    assert 0.1 < wanted.crash.mean() < 0.9
    assert own.crash.tolist() == wanted.crash.tolist()
    if kind != "fmu":
        for name in CUT_IN.outcome_names:
            np.testing.assert_allclose(getattr(own, name), getattr(wanted, name), rtol=1e-12, atol=1e-12)
    else:  # whose outcomes are those at steps of 0.01 s
        safe = ~own.crash
        np.testing.assert_allclose(own.min_range[safe], wanted.min_range[safe], atol=2e-3)
        np.testing.assert_allclose(own.min_ttc[safe], wanted.min_ttc[safe], atol=0.02)
        np.testing.assert_allclose(own.impact_speed, wanted.impact_speed, atol=0.07)


@pytest.fixture(scope="module")
def family(tmp_path_factory):
    """Return where the fit of all laws is kept: the vehicles of the guide have the same records."""
    return tmp_path_factory.mktemp("laws") / "family.npz"


LONG = pytest.mark.studies, pytest.mark.rest  # the same estimate with vehicles that the test above compares


@pytest.mark.parametrize(
    "kind", ["class", "staying", pytest.param("command", marks=LONG), pytest.param("fmu", marks=LONG)]
)
def test_an_example_gives_a_crash_probability(clone, capsys, family, kind):
    require(kind)
    kept = Path("results", f"my_{kind}", "laws", "family.npz")
    kept.parent.mkdir(parents=True)
    if family.exists():
        shutil.copy(family, kept)
    line = next(line for block in COMMANDS for line in block.splitlines() if f" my_{kind}.yaml" in line)
    words = [*line.split()[1:], "--config", "fewer.yaml", "--verbose"]
    tables, reported = [], []
    for _ in range(1 if kind == "class" else 2):  # the second time the store is full
        assert cli.main(words) == 0
        reported.append(capsys.readouterr().out)
        folder = Path("results", f"my_{kind}", "estimate")
        tables.append([(folder / f"{name}.csv").read_bytes() for name in ("estimate", "runs", "account")])
        assert (folder / "law.json").is_file()
    shutil.copy(kept, family)
    assert tables[0] == tables[-1]
    estimate = pd.read_csv(folder / "estimate.csv").iloc[0]
    runs = len(pd.read_csv(folder / "runs.csv"))
    assert estimate.learning + estimate.estimating == runs <= 100
    assert runs == 100 or estimate.converged
    assert estimate.events > 0
    if kind == "class":
        assert "store" not in reported[0]
    else:
        kept = runs + int(pd.read_csv(folder / "replays.csv")["replayed"].iloc[-1])
        # Some runs are repeated in this process, and as many in another one; neither are kept again.
        stored = f"simulated: {kept + 16}; taken from the store: 0; kept: {kept} in results/vehicles/"
        assert stored in reported[0]
        assert f"simulated: 0; taken from the store: {kept + 8}; kept: {kept} " in reported[1]


def test_the_command_can_be_tried_by_hand(clone):
    require("command")
    block = next(block for block in COMMANDS if block.startswith("printf"))
    program = f'accelerated-evaluation() {{ {sys.executable} -m accelerated_evaluation.cli "$@"; }}\n'
    done = subprocess.run(["bash", "-e", "-c", program + block], capture_output=True, text=True, check=True)
    header, one, two = done.stdout.splitlines()[-3:]  # after what the command says about stored outcomes
    assert header == "lead_speed,range,closing_speed,crash,min_range,min_ttc,impact_speed"
    assert [float(cell) for cell in one.split(",")[3:]] == pytest.approx([0, 10 - 3.75 - 25 / 12, 1.25, 0])
    assert two.split(",")[3] == "1"


def test_the_configuration_of_the_guide_is_valid(clone):
    blocks = [content for language, content in BLOCKS if language == "yaml"]
    assert len(blocks) == 8
    for block in blocks:
        Path("block.yaml").write_text(block)
        load(["block.yaml"])


def test_all_files_of_the_guide_are_tried():
    example = {"my_vehicle.py", "my_class.yaml", "my_vehicle.awk", "my_command.yaml"}
    example |= {"my_comparison.yaml"}  # tests/workflow/test_own_vehicles.py
    example |= {"my_staying.yaml", "my_staying.cpp", "my_staying.py"}
    example |= {"my_slow_study.yaml"}  # the settings of tests/workflow/test_slow_study.py
    assert set(FILES) == example | {"my_fmu.yaml", "my_vehicle.c", "unused.c", "modelDescription.xml"}
