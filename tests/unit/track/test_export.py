"""A weighted set of scenarios: its recipe gives the exact probability, and its files are valid."""

import csv
import re
from dataclasses import replace
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pandas as pd
import pytest
from accelerated_evaluation import InputError, cli, load_vehicle, map_crashes, read_law
from accelerated_evaluation.crash_map.exact import ALL, exact_probabilities
from accelerated_evaluation.laws.motion import SPEED_COLUMNS
from accelerated_evaluation.records.segments import read_encounters
from accelerated_evaluation.scenarios.cut_in import CUT_IN
from accelerated_evaluation.track.export import page, table_of
from accelerated_evaluation.track.scenarios import ConcreteScenario, path_speeds
from accelerated_evaluation.track.weighted_set import SHELLS, draw_weighted_set
from builders import coarse_grid
from law_folder import LAW, write_law_folder

SIZE = 300
GRID = coarse_grid(speeds=(5, 15.0001, 20), ranges=(75, 40), closing=(23.49, 160), refinement=4)
SETS = 60


def exact(vehicle):
    """The exact crash probability, by the crash map, and its standard error."""
    crash_map = map_crashes(vehicle, GRID, [], np.random.default_rng(1))
    found = exact_probabilities(crash_map, LAW)[ALL]
    return found.probability, found.standard_error


@pytest.fixture(scope="module")
def sets():
    return [draw_weighted_set(LAW, SIZE, 1.5, np.random.default_rng(seed)) for seed in range(SETS)]


def follow(drawn, vehicle, folder):
    """Do what the page says, with its own script; return what it computes."""
    folder.mkdir(exist_ok=True)
    names = [f"scenario_{number:03d}" for number in drawn.table["scenario"]]
    table_of(drawn, names, CUT_IN).to_csv(folder / "scenarios.csv", index=False)
    rows = list(csv.DictReader((folder / "scenarios.csv").open()))
    columns = ([float(row[name]) for row in rows] for name in ("lead_speed", "range", "closing_speed"))
    crash = vehicle.simulate(*columns).crash
    lines = [f"{row['scenario']},{int(flag)}\n" for row, flag in zip(rows, crash, strict=True)]
    (folder / "outcomes.csv").write_text("scenario,crash\n" + "".join(lines))
    script = re.search(r"```python\n(.*?)```", page(drawn, {}, CUT_IN), re.DOTALL)[1]
    assert len(script.splitlines()) <= 30
    found = {}
    exec(script.replace('open("', f'open("{folder}/'), found)
    return found


@pytest.mark.parametrize("name", ["acc_aeb", "acc_only"])
def test_the_recipe_gives_the_exact_probability_within_its_error(sets, tmp_path, capsys, name):
    vehicle = load_vehicle(name)
    truth, error = exact(vehicle)
    found = [follow(drawn, vehicle, tmp_path) for drawn in sets]
    estimates = np.array([one["probability"] for one in found])
    reach = 3.5 * np.hypot(np.sqrt(np.mean([one["variance"] for one in found]) / SETS), error)
    assert abs(estimates.mean() - truth) < reach
    assert reach < 0.3 * truth
    covered = [one["low"] <= truth <= one["high"] for one in found]
    assert np.mean(covered) > 0.5
    assert "80% interval" in capsys.readouterr().out


def test_a_wrong_weight_is_noticed(sets, tmp_path):
    """With the weights of the next shell the same outcomes give another number."""
    vehicle = load_vehicle("acc_aeb")
    truth, _ = exact(vehicle)
    found = []
    for drawn in sets:
        wrong = drawn.table.assign(weight=np.roll(drawn.table["weight"], SIZE // SHELLS))
        found.append(follow(type(drawn)(wrong, drawn.edges, drawn.probabilities), vehicle, tmp_path))
    mean = np.mean([one["probability"] for one in found])
    assert abs(mean - truth) > 5 * np.sqrt(np.mean([one["variance"] for one in found]) / SETS)


class Never:
    def simulate(self, lead_speed, range_, closing_speed):
        return load_vehicle("acc_aeb").simulate(lead_speed, 1000 + 0 * np.array(range_), closing_speed)


def test_without_a_crash_there_is_an_upper_end_that_no_shell_exceeds(sets, tmp_path):
    found = follow(sets[0], Never(), tmp_path)
    assert found["probability"] == found["low"] == 0
    assert found["high"] == pytest.approx(sets[0].probabilities.max() * (1 - 0.2 ** (1 / 20)))


def test_shells_have_the_probabilities_of_the_law(sets):
    """Against plain draws from the law, and each cut-in in its shell."""
    drawn = sets[0]
    free = replace(LAW, closing_speed_max=np.inf)
    _, range_, closing_speed = free.draw(2_000_000, np.random.default_rng(8)).T
    needed = closing_speed**2 / 2 / range_
    counts = np.histogram(needed, [*drawn.edges, np.inf])[0] / needed.size
    deviation = np.sqrt(drawn.probabilities / needed.size)
    assert np.all(np.abs(counts - drawn.probabilities) < 4.5 * deviation)
    assert drawn.assumed_safe == pytest.approx(np.mean(needed < drawn.edges[0]), rel=1e-3)
    rows = drawn.table[drawn.table["closing_speed"] < LAW.closing_speed_max]
    needed = rows["closing_speed"] ** 2 / 2 / rows["range"]
    assert np.array_equal(np.searchsorted(drawn.edges, needed * (1 + 1e-9), side="right"), rows["shell"])


@pytest.mark.parametrize(("size", "safe"), [(29, 1.5), (301, 1.5), (300, 0.0), (300, 9.0), (300, np.nan)])
def test_a_set_cannot_be_of_any_size(size, safe):
    with pytest.raises(InputError, match="--s"):
        draw_weighted_set(LAW, size, safe, np.random.default_rng(1))


@pytest.fixture(scope="module")
def exported(tmp_path_factory):
    pytest.importorskip("scenariogeneration", reason="the extra `scenarios` is not installed")
    folder = tmp_path_factory.mktemp("export")
    law, encounters = write_law_folder(folder)
    command = ["export", str(folder / "set"), "--law", str(law), "--encounters", str(encounters)]
    assert cli.main([*command, "--size", "45"]) == 0
    return folder, command


def test_the_folder_holds_all_that_the_page_names(exported):
    folder, command = exported
    table = pd.read_csv(folder / "set" / "scenarios.csv")
    assert len(table) == 45
    assert all((folder / "set" / name).is_file() for name in table["file"])
    text = (folder / "set" / "README.md").read_text()
    assert "of all cut-ins are assumed to be safe" in text
    assert not re.search(r"[{}]", re.sub(r"```.*?```", "", text, flags=re.DOTALL))
    first = (folder / "set" / "scenario_001.xosc").read_text()
    assert f'<Property name="weight" value="{float(table["weight"][0])!r}"/>' in first
    law = read_law(folder / "law.json", read_encounters(folder / "encounters.parquet"))
    assert law.description in text
    again = [part.replace(str(folder / "set"), str(folder / "again")) for part in command]
    assert cli.main([*again, "--size", "45"]) == 0
    same = {path.name: path.read_bytes() for path in (folder / "again").iterdir()}
    assert same == {path.name: path.read_bytes() for path in (folder / "set").iterdir()}


def played(path, *, step=0.001, profile=True, until=5.0):
    """Play a file as OpenSCENARIO says: speeds along the path, a sinusoidal change of lane, linear profiles.

    Return the state of both cars when the middle of the lead crosses the marking, or at a given time after
    the start: the time, the range, and the speeds along the road of the host and the lead.
    """
    tree = ElementTree.parse(path)
    place, speed, lane = {}, {}, {}
    for car in ("host", "lead"):
        own = tree.find(f".//Init/Actions/Private[@entityRef='{car}']")
        place[car] = float(own.find(".//LanePosition").get("s"))
        lane[car] = int(own.find(".//LanePosition").get("laneId"))
        speed[car] = float(own.find(".//AbsoluteTargetSpeed").get("value"))
    change = tree.find(".//LaneChangeAction")
    assert int(change.find(".//AbsoluteTargetLane").get("value")) == lane["host"] == lane["lead"] + 1
    dynamics = change.find("LaneChangeActionDynamics")
    assert (dynamics.get("dynamicsShape"), dynamics.get("dynamicsDimension")) == ("sinusoidal", "time")
    lasts = float(dynamics.get("value"))
    begins = {
        event.get("name"): float(event.find(".//SimulationTimeCondition").get("value"))
        for event in tree.findall(".//Event")
    }
    entries = tree.findall(".//SpeedProfileEntry") if profile else []
    times = np.cumsum([float(entry.get("time")) for entry in entries])
    speeds = [float(entry.get("speed")) for entry in entries]
    length = float(tree.find(".//ScenarioObject[@name='lead']//Dimensions").get("length"))
    # A player notices at the first step on or after the moment of a condition that it is fulfilled.
    begun = {name: step * np.ceil(at / step - 1e-9) for name, at in begins.items()}

    def across(time):
        share = np.clip((time - begun["cut_in"]) / lasts, 0, 1)
        return 3.5 * (1 - np.cos(np.pi * share)) / 2

    time, s_lead, s_host = 0.0, place["lead"], place["host"]
    while time < until - 1e-9 if until else across(time) < 1.75 - 1e-9:
        middle = time + step / 2
        path_speed = np.interp(middle - begun["lead_motion"], times, speeds) if entries else speed["lead"]
        aside = across(time + step) - across(time)
        along = np.sqrt(max((path_speed * step) ** 2 - aside**2, 0.0))
        time, s_lead, s_host = time + step, s_lead + along, s_host + speed["host"] * step
    return time, s_lead - s_host - length, speed["host"], along / step


def test_a_scenario_has_the_cut_in_of_the_table_when_the_car_crosses_the_marking(exported):
    """Integrated along the path; with a constant speed, the wrong variant, the lead car loses way."""
    table = pd.read_csv(exported[0] / "set" / "scenarios.csv")
    for row in table.to_dict("records")[::9]:
        path = exported[0] / "set" / row["file"]
        moment = float(ElementTree.parse(path).find(".//Property[@name='moment']").get("value"))
        time, range_, host, lead = played(path, until=None)
        assert time == pytest.approx(moment, abs=2e-3)
        assert range_ - row["closing_speed"] * (moment - time) == pytest.approx(row["range"], abs=1e-3)
        assert (lead, host) == pytest.approx((row["lead_speed"], row["host_speed"]), abs=1e-3)
        assert played(path, until=9.0)[1] == pytest.approx(row["range"] - 4 * row["closing_speed"], abs=2e-3)
        _, short, _, slow = played(path, profile=False, until=moment)
        assert row["range"] - short > 0.03
        assert row["lead_speed"] - slow > 0.03


def test_the_step_of_a_player_delays_the_crossing_by_one_step_at_most(exported):
    table = pd.read_csv(exported[0] / "set" / "scenarios.csv")
    row = table.to_dict("records")[-1]
    for step in (1 / 30, 0.005):
        time, range_, *_ = played(exported[0] / "set" / row["file"], step=step, until=None)
        late = (row["range"] - range_) / row["closing_speed"]
        assert late == pytest.approx(time - 5.0, abs=1e-3)
        assert -1e-6 <= late <= 2 * step + 1e-6


def test_the_speed_along_the_path_is_that_of_road_and_lane_change_together():
    still = path_speeds(ConcreteScenario("still", 0.0, 10.0, 5.0, {}))
    assert still.max() == pytest.approx(3.5 * np.pi / 8)
    assert still[[0, -1]] == pytest.approx([0, 0], abs=1e-12)
    slowing = ConcreteScenario("slowing", 10.0, 10.0, 5.0, {}, [10.0 - 0.1 * k for k in range(1, 81)])
    speeds = path_speeds(slowing)
    assert len(speeds) == 20 + 81
    assert speeds[20] == pytest.approx(np.hypot(10.0, 3.5 * np.pi / 8))
    assert speeds[40:] == pytest.approx(slowing.later_speeds[19:])


@pytest.fixture(scope="module")
def moving(exported):
    folder, command = exported
    command = [part.replace(str(folder / "set"), str(folder / "moving")) for part in command]
    assert cli.main([*command, "--size", "30", "--motion", "ngsim"]) == 0
    return folder / "moving"


def test_a_moving_lead_has_the_speed_profile_of_the_table(moving):
    """Played by hand: the speeds of the profile at the times since the moment of the cut-in."""
    table = pd.read_csv(moving / "scenarios.csv")
    speeds = table[list(SPEED_COLUMNS)]
    assert (speeds >= 0).all(axis=None)
    assert (speeds.std(axis=1) > 0).all()
    for row in table.to_dict("records")[::7]:
        tree = ElementTree.parse(moving / row["file"])
        event = tree.find(".//Event[@name='lead_motion']")
        moment = float(tree.find(".//Property[@name='moment']").get("value"))
        assert float(event.find(".//SimulationTimeCondition").get("value")) == moment - 2.0
        entries = event.findall(".//SpeedProfileEntry")
        times = np.cumsum([float(entry.get("time")) for entry in entries])
        np.testing.assert_allclose(times, 0.1 * np.arange(101), atol=1e-12)
        shown = np.array([float(entry.get("speed")) for entry in entries])
        aside = np.where(times < 4, 3.5 * np.pi / 8 * np.sin(np.pi * times / 4), 0.0)
        along = np.sqrt(np.maximum(shown**2 - aside**2, 0))
        wanted = [row["lead_speed"]] * 20 + [row[name] for name in ("lead_speed", *SPEED_COLUMNS)]
        np.testing.assert_allclose(along, wanted, rtol=1e-6, atol=1e-6)
        # The two events must not end each other: each is in a manoeuvre of its own.
        both = [maneuver.findall("Event") for maneuver in tree.findall(".//Maneuver")]
        assert [[event.get("name") for event in events] for events in both] == [["cut_in"], ["lead_motion"]]
        assert both[0][0].find(".//LaneChangeAction") is not None
    text = (moving / "README.md").read_text()
    assert "and then changes its speed;" in text
    assert "lead motion: ngsim" in text
    assert not re.search(r"[{}]", re.sub(r"```.*?```", "", text, flags=re.DOTALL))


def test_the_table_of_moving_leads_can_be_simulated(moving, tmp_path):
    assert cli.main(["simulate", str(moving / "scenarios.csv"), str(tmp_path / "out.csv")]) == 0
    table = pd.read_csv(moving / "scenarios.csv")
    columns = [table[name].to_numpy() for name in ("lead_speed", "range", "closing_speed")]
    speeds = table[["lead_speed", *SPEED_COLUMNS]].to_numpy()
    wanted = load_vehicle("acc_aeb").simulate_moving(*columns, speeds)
    np.testing.assert_allclose(pd.read_csv(tmp_path / "out.csv")["min_range"], wanted.min_range, rtol=1e-6)


def test_every_exported_file_is_valid_for_asams_checker(exported, moving):
    pytest.importorskip("qc_openscenario", reason="ASAM's checker is not installed")
    from asam_checker import verdict

    files = sorted((exported[0] / "set").glob("*.xosc"))
    assert len(files) == 45
    files += sorted(moving.glob("*.xosc"))[:3]
    for path in files:
        completed, issues = verdict(path)
        assert issues == []
        assert len(completed) >= 15


def test_export_refuses_what_it_cannot_do(exported, capsys, tmp_path):
    folder, command = exported
    assert cli.main(command) == 2
    assert "seen a file, or a folder with files; expected no folder yet" in capsys.readouterr().err
    for arguments, message in (
        (["--size", "1000"], "--size: seen 1000; expected 30 to 300 scenarios"),
        (["--safe-deceleration", "99"], "--safe-deceleration: seen 99"),
        (["--seed", "-3"], "--seed: seen -3"),
        (["--law", "none.json"], "none.json: seen no such file"),
        (["--encounters", str(folder / "law.json")], "content that cannot be read"),
    ):
        assert cli.main(["export", str(tmp_path / "other"), *command[2:], *arguments]) == 2
        assert message in capsys.readouterr().err
        assert list(Path(tmp_path).iterdir()) == []
    assert cli.main(["export", "/dev/null/set", *command[2:]]) == 2
    assert '/dev/null: seen "File exists"; expected a file' in capsys.readouterr().err
