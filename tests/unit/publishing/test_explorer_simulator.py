"""The explorer's JavaScript: simulations as in Python, to the last bit, and numbers as in tables.

They run in Node.js, which comes with Playwright, and in Chromium, where these tests are not left out.
"""

import json
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from accelerated_evaluation.publishing.explorer.vehicles import as_texts
from accelerated_evaluation.publishing.texts import unbroken
from accelerated_evaluation.scenarios.left_turn import LEFT_TURN
from accelerated_evaluation.vehicles import load_vehicle
from conftest import ROOT

OUTCOMES = ("crash", "min_range", "impact_speed")
OF_TURNS = ("crash", "min_distance", "impact_speed")
SOURCE = (ROOT / "workflow/explorer/simulator.js").read_text()
READ = "Object.fromEntries(Object.entries(texts).map(([name, text]) => [name, Number(text)]))"
# Numbers are exchanged as texts, because JSON has no infinity. No digit is lost by this.
RUN = f"""([kernel, texts, encounters]) => {{
  const found = simulate(kernel, {READ}, ...encounters.map((row) => Float64Array.from(row)));
  return Object.values(found).map((values) => Array.from(values, String));
}}"""
TRACE = f"""([kernel, texts, encounter]) =>
  trace(kernel, {READ}, encounter)
    .map((state) => Object.values(state).map(String))"""
VEHICLES = [
    ("car", "acc_aeb", {}),
    ("car", "acc_aeb", {"aeb_ttc": 1.7, "aeb_release_ttc": 1.9, "aeb_deceleration": 6.0, "headway": 1.3}),
    ("car", "acc_only", {}),
    ("driver", "cc_human", {}),
    ("driver", "cc_human", {"reaction_time": 0.3, "keeps_watching": False}),
    ("driver", "reg157", {}),
    ("driver", "rss", {"lateral_speed": 0.7}),
    ("driver", "fsm", {}),
    ("driver", "fsm", {"lateral_speed": 1.1, "entry_offset": 1.75}),
    ("driver", "fsm", {"lateral_speed": 0.3}),
]


def in_node(function, asked):
    driver = pytest.importorskip("playwright", reason="Playwright is not installed")
    own = Path(driver.__file__).parent / "driver/node"
    node = own if own.is_file() else shutil.which("node")
    if node is None:
        pytest.skip("no Node.js is installed on this machine")
    script = f"{SOURCE}\nconst asked = JSON.parse(require('fs').readFileSync(0, 'utf8'));\n"
    script += f"process.stdout.write(JSON.stringify(({function})(asked)));"
    done = subprocess.run([node, "-e", script], input=json.dumps(asked), capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)


@pytest.fixture(scope="module", params=["node", pytest.param("chromium", marks=pytest.mark.browser)])
def javascript(request):
    """Return a function that calls a JavaScript function with an argument, next to the simulator's code."""
    if request.param == "node":
        yield in_node
        return
    page = request.getfixturevalue("browser").new_page()
    page.add_script_tag(content=SOURCE)
    yield page.evaluate
    page.close()


@pytest.mark.parametrize(("kernel", "name", "parameters"), VEHICLES)
def test_outcomes_are_those_of_python_to_the_bit(javascript, kernel, name, parameters):
    generator = np.random.default_rng(5)
    lead_speed, range_, closing_speed = generator.random((3, 20_000)) * [[35.0], [75.0], [45.0]]
    encounters = np.array([lead_speed, range_, np.maximum(closing_speed - 10, -lead_speed)])
    vehicle = load_vehicle(name, **parameters)
    expected = vehicle.simulate(*encounters)
    found = javascript(RUN, [kernel, as_texts(vehicle.compiled()), encounters.tolist()])
    for outcome, values in zip(OUTCOMES, found, strict=True):
        np.testing.assert_array_equal(np.array(values, float), getattr(expected, outcome), err_msg=outcome)
    other = load_vehicle("acc_aeb", headway=1.9) if kernel == "car" else load_vehicle("cc_human", jerk=12.0)
    assert javascript(RUN, [kernel, as_texts(other.compiled()), encounters.tolist()])[1] != found[1]


def test_every_published_verdict(javascript, stored):
    table = stored("verdicts.parquet")
    assert len(table) == 4695
    encounters = table[["lead_speed", "range", "closing_speed"]].to_numpy().T.tolist()
    crash = javascript(RUN, ["car", as_texts(load_vehicle("acc_aeb").compiled()), encounters])[0]
    np.testing.assert_array_equal(np.array(crash, float), table.crash)


@pytest.mark.parametrize(
    ("kernel", "name", "encounter"),
    [
        ("car", "acc_aeb", (9.0, 41.7, 24.7)),
        ("car", "acc_aeb", (20.0, 30.0, 3.0)),
        ("driver", "cc_human", (8.0, 64.0, 10.0)),
        ("driver", "fsm", (15.0, 70.0, 0.5)),
    ],
)
def test_a_trace_is_that_of_the_library(javascript, kernel, name, encounter):
    vehicle = load_vehicle(name)
    states = javascript(TRACE, [kernel, as_texts(vehicle.compiled()), list(encounter)])
    expected = vehicle.trace(*encounter)
    _, gap, _, speed, acceleration, ttc, emergency = zip(*states, strict=True)
    columns = {
        "range_m": gap,
        "host_speed_m_per_s": speed,
        "host_acceleration_m_per_s2": acceleration,
        "time_to_collision_s": ttc,
    }
    for column, values in columns.items():
        np.testing.assert_allclose(np.array(values, float), expected[column], rtol=0, atol=1e-12)
    assert [value == "true" for value in emergency] == (expected["emergency"] == 1).tolist()


@pytest.mark.parametrize(
    "parameters", [{}, {"aeb_ttc": 1.7, "aeb_release_ttc": 1.9, "headway": 1.4}, {"aeb": False}]
)
def test_left_turns_are_those_of_python_within_rounding(javascript, parameters):
    """Browsers round cosines differently, which matters for a car that creeps behind a slow target."""
    generator = np.random.default_rng(6)
    encounters = generator.random((3, 8_000)) * [[35.0], [12.0], [60.0]] + [[0.0], [0.6], [0.0]]
    vehicle = load_vehicle("acc_aeb", "left_turn", **parameters)
    expected = vehicle.simulate(*encounters)
    found = javascript(RUN, ["turn", as_texts(vehicle.compiled()), encounters.tolist()])
    for outcome, values in zip(OF_TURNS, found, strict=True):
        differ = ~np.isclose(np.array(values, float), getattr(expected, outcome), rtol=1e-9, atol=1e-6)
        assert differ.mean() < 1e-3, outcome
    assert 0.02 < expected.crash.mean() < 0.9
    other = load_vehicle("acc_aeb", "left_turn", **{"headway": 2.0, **parameters, "kp": 20.0})
    assert javascript(RUN, ["turn", as_texts(other.compiled()), encounters.tolist()])[1] != found[1]


def test_published_verdicts_of_left_turns(javascript):
    table = pd.read_csv(ROOT / LEFT_TURN.records.verdicts)
    encounters = table[list(LEFT_TURN.names)].to_numpy().T.tolist()
    car = load_vehicle("acc_aeb", "left_turn").compiled()
    crash = np.array(javascript(RUN, ["turn", as_texts(car), encounters])[0], float)
    firm = (table["fragile"] == 0).to_numpy()
    np.testing.assert_array_equal(crash[firm], table["crash"].to_numpy()[firm])


def test_a_trace_of_a_left_turn_is_that_of_the_library(javascript):
    vehicle, encounter = load_vehicle("acc_aeb", "left_turn"), (14.0, 3.0, 9.0)
    states = javascript(TRACE, ["turn", as_texts(vehicle.compiled()), list(encounter)])
    columns = list(zip(*states, strict=True))
    expected = vehicle.trace(*encounter)
    assert len(states) == len(expected)
    for values, name in zip(columns[:5], expected.columns, strict=False):
        np.testing.assert_allclose(np.array(values, float), expected[name], rtol=0, atol=1e-9)
    assert [value == "true" for value in columns[5]] == (expected["emergency"] == 1).tolist()


def test_numbers_are_written_as_in_the_tables(javascript):
    view = (ROOT / "workflow" / "explorer" / "view.js").read_text()
    scales = 10.0 ** np.arange(-9, 9)
    values = [0.0, 1.0, 983.0, 7840.0, 1e6, 2e-5, 3e-3, *(3.14159 * scales), *(-2.04e-3 * scales)]
    for digits in (2, 3):
        written = f"(values) => {{ {view}\nreturn values.map((value) => readable(value, {digits})); }}"
        expected = [unbroken(value, digits) for value in values]
        assert javascript(written, values) == expected
