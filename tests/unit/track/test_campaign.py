"""A campaign driven by its commands: same result as the sampler, any order of runs, nothing wrong taken."""

import contextlib
import json
import re
import shutil
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from accelerated_evaluation import CUT_IN, SCENARIOS, Problem, Stopping, child_generator, cli, load_vehicle
from accelerated_evaluation.methods import METHODS, Estimate
from accelerated_evaluation.track.campaign_file import read_campaign, write_campaign
from accelerated_evaluation.track.limits import UNLIMITED, USUAL, Limits
from accelerated_evaluation.track.results import forecast, read_results, status_of
from fewruns import state as sampler_state
from fewruns.combining import interval
from law_folder import LAW, SPEEDS, begin_campaign, write_law_folder

ROOT = Path(__file__).resolve().parents[3]
sys.path.append(str(ROOT / "benchmarks"))

import campaign_transcript as transcript  # noqa: E402

TUTORIAL = ROOT / "docs" / "campaign.md"
GOAL = Stopping(alpha=0.2, beta=0.5, minimum_events=1)


@pytest.fixture(scope="module")
def prepared(tmp_path_factory):
    """A folder with a campaign that has begun, and a function that runs one step of that in any folder."""
    folder = tmp_path_factory.mktemp("campaign")
    with contextlib.chdir(folder):
        return folder, begin_campaign(folder)


@pytest.fixture
def begun(prepared, tmp_path, monkeypatch):
    """A campaign in the current folder, and a function that runs one step of it."""
    folder, step = prepared
    monkeypatch.chdir(shutil.copytree(folder, tmp_path, dirs_exist_ok=True))
    return step


def drive(source="next/runs.csv", target="done.csv"):
    """Let the built-in car be the driver."""
    assert cli.main(["simulate", str(source), str(target)]) == 0
    return pd.read_csv(target)


class Rounded:
    """The built-in car in cut-ins that are rounded to what can be driven."""

    deterministic = True

    def simulate(self, *columns):
        return load_vehicle("acc_aeb").simulate(*CUT_IN.settable(np.array(columns).T).T)


def test_a_campaign_is_the_sampler_told_run_by_run(begun):
    """Shuffled tables and parts of batches, through files all the way, give the same bits."""
    generator = np.random.default_rng(0)
    while not status_of(read_campaign("c.json")).may_stop:
        assert begun("ask", "next", "--no-scenarios") == 0
        done = drive().sample(frac=1, random_state=generator)
        for part in (done.iloc[:4], done):  # the second table repeats what was told already
            part.to_csv("part.csv", index=False)
            assert begun("tell", "part.csv") == 0
    surrogate = METHODS["surrogate"](batch_size=10)
    wanted = surrogate.estimate(Problem(CUT_IN, Rounded(), law=LAW), GOAL, child_generator(4, "campaign"))
    assert status_of(read_campaign("c.json")).estimate.row() == wanted.row()


def test_runs_that_are_out_are_not_requested_a_second_time_unless_it_is_said(begun, capsys):
    """Two people who ask at the same moment do not get the same runs."""
    command = [sys.executable, "-m", "accelerated_evaluation.cli", "campaign", "ask", "c.json"]
    both = [
        subprocess.Popen([*command, folder, "--no-scenarios"], stderr=subprocess.PIPE, text=True)
        for folder in ("one", "two")
    ]
    said = [each.communicate()[1] for each in both]
    assert sorted(each.returncode for each in both) == [0, 2]
    assert sum(Path(folder).exists() for folder in ("one", "two")) == 1
    assert "10 runs (1 to 10) of an earlier request without outcomes" in "".join(said)
    runs = pd.read_csv("one/runs.csv" if Path("one").exists() else "two/runs.csv")
    assert begun("ask", "next", "--no-scenarios", "--again") == 0
    pd.testing.assert_frame_equal(pd.read_csv("next/runs.csv"), runs)
    drive().iloc[:7].to_csv("part.csv", index=False)
    assert begun("tell", "part.csv") == 0
    assert begun("ask", "more", "--no-scenarios") == 2
    assert "3 runs (8 to 10)" in capsys.readouterr().err


@pytest.mark.parametrize("scenario", SCENARIOS.values(), ids=SCENARIOS)
def test_runs_are_rounded_to_what_can_be_set(scenario):
    limits = np.clip(scenario.limits, -30, 30)
    x = np.random.default_rng(1).uniform(*limits.T, (1000, scenario.dimension))
    x[0] = np.clip(0.005, *limits.T)  # such as a range of 5 mm
    x = x[~np.any([wrong for wrong, *_ in scenario._faults(x.T)], axis=0)]  # such as a host that reverses
    assert len(x) > 500
    rounded, steps = scenario.settable(x), np.array([each.step for each in scenario.variables])
    assert max(len(repr(value)) for value in rounded.ravel().tolist()) <= len("-12.34")
    np.testing.assert_allclose(rounded / steps, np.round(rounded / steps), rtol=1e-12)
    # A whole step where less than half a step would become 0, or where rounding up would break a rule.
    assert (np.abs(rounded - x) <= steps * (1 + 1e-9)).all()
    assert (np.abs(rounded - x) <= steps * (0.5 + 1e-9)).mean() > 0.99
    assert (rounded[0] > 0).all()
    scenario.checked(*rounded.T)


def test_rounding_hardly_changes_the_probability():
    """Of crashes among cut-ins near the limit of the car; rounded to whole m/s and m, it changes by more."""
    generator, car = np.random.default_rng(3), load_vehicle("acc_aeb")
    x = np.column_stack(
        [generator.choice(SPEEDS, 200_000), *generator.uniform(1, [[20], [15]], (2, 200_000))]
    )
    exact, rounded, coarse = (
        car.simulate(*each.T).crash * 1.0 for each in (x, CUT_IN.settable(x), np.round(x))
    )
    changed = [(each - exact).mean() / exact.mean() for each in (rounded, coarse)]
    error = (rounded - exact).std() / len(x) ** 0.5 / exact.mean()
    assert 0.1 < exact.mean() < 0.9
    assert abs(changed[0]) < 0.002 + 4 * error
    assert error < 0.002
    assert np.mean(rounded != exact) < 0.2 * np.mean(coarse != exact)


def test_a_campaign_has_the_limits_of_a_proving_ground_unless_it_is_said(begun, capsys):
    files = ["--law", "law.json", "--encounters", "encounters.parquet"]
    for options, wanted in (
        ([], USUAL),
        (["--no-limits"], UNLIMITED),
        (["--host-speed-max", "30"], replace(USUAL, host_speed_max=30.0)),
        (["--no-limits", "--range-min", "2"], Limits(range_min=2.0)),
    ):
        Path("usual.json").unlink(missing_ok=True)
        assert cli.main(["campaign", "new", "usual.json", *files, *options]) == 0
        assert read_campaign("usual.json").limits == wanted
        assert ("the campaign drives only runs within" in capsys.readouterr().out) == bool(wanted)


def driven_to_the_end(begun, *, batches=60):
    for _ in range(batches):
        if status_of(read_campaign("c.json")).may_stop:
            return
        begun("ask", "next", "--no-scenarios")
        drive()
        assert begun("tell", "done.csv") == 0


def test_a_new_version_of_the_sampler_goes_on_with_a_batch_that_is_out(begun, monkeypatch):
    while not read_campaign("c.json").estimate().probability > 0:
        begun("ask", "next", "--no-scenarios")
        drive()
        begun("tell", "done.csv")
    begun("ask", "next", "--no-scenarios")
    before = read_campaign("c.json")
    monkeypatch.setattr(sampler_state, "VERSION", sampler_state.VERSION + 1)  # of the program
    after = read_campaign("c.json")
    assert len(after.outstanding) == 10
    assert after.estimate().simulations == before.estimate().simulations
    assert after.estimate().probability == pytest.approx(before.estimate().probability, nan_ok=True)
    drive()
    assert begun("tell", "done.csv") == 0
    driven_to_the_end(begun)
    found = read_campaign("c.json").estimate()
    assert found.converged
    assert found.simulations == len(read_campaign("c.json").runs)


def test_another_batch_size_holds_from_the_next_batch_on(begun):
    begun("ask", "next", "--no-scenarios")
    assert begun("ask", "next", "--no-scenarios", "--batch-size", 25, "--again") == 0
    assert len(drive()) == 10
    begun("tell", "done.csv")
    begun("ask", "next", "--no-scenarios")
    runs = drive()["run"].tolist()  # while it searches, the sampler may ask for fewer
    assert runs == list(range(11, 11 + len(runs)))
    assert 10 < len(runs) <= 25
    begun("tell", "done.csv")
    driven_to_the_end(begun)
    assert status_of(read_campaign("c.json")).may_stop


def test_the_estimate_counts_whole_batches_alone(begun):
    assert status_of(read_campaign("c.json")).needed is None
    for _ in range(2):
        begun("ask", "next", "--no-scenarios")
        done = drive()
        begun("tell", "done.csv")
    begun("ask", "next", "--no-scenarios")
    drive().head(7).to_csv("part.csv", index=False)
    begun("tell", "part.csv")
    now = status_of(read_campaign("c.json"))
    assert (now.asked, now.reported, now.used) == (30, 27, 20)
    assert len(done) == 10


def test_the_forecast_is_the_least_number_of_batches_that_meets_the_goal():
    diagnostics = {"batches": 10, "observed_error": 0.5, "predicted_error": 0.1}
    found = Estimate(1e-6, 0, 2e-6, 0.2, 100, 100, 20, False, diagnostics)
    runs = forecast(found, 10, GOAL)
    assert runs % 10 == 0
    half_widths = []
    for more in (runs // 10 - 1, runs // 10):
        low, high = interval(1.0, 0.5 * (10 / (10 + more)) ** 0.5, 10 + more, GOAL.alpha)
        half_widths.append((high - low) / 2)
    assert half_widths[1] <= GOAL.beta < half_widths[0]
    assert forecast(found, 10, Stopping(0.2, 0.05)) > 50 * runs
    assert forecast(replace(found, probability=np.nan), 10, GOAL) is None


WRONG = {
    "run,crash\n11,0\n": "row 2, column run: seen 11; expected the number of a requested run",
    "run,crash\n1.5,0\n": "row 2, column run: seen 1.5",
    "run,crash\n,0\n": "row 2, column run: seen nothing",
    "run,crash\none,0\n": "row 2, column run: seen 'one'; expected a number",
    "run,crash\n1,maybe\n": "row 2, column crash: seen 'maybe'",
    "run,crash\n1,0\n1,1\n": "row 3: seen run 1 a second time, with another outcome",
    "run,crash,min_range\n1,,3\n": "row 2, column crash: seen nothing",
    "run,crash,min_range\n1,1,0.4\n": "row 2, column min_range: seen 0.4; expected 0 or less with a crash",
    "run,crash,min_range\n1,0,-0.4\n": "row 2, column min_range: seen -0.4; expected above 0 without a crash",
    "run,crash,min_range\n1,0,1e9\n": "row 2, column min_range: seen 1e+09",
    "run,crash,min_range\n1,1,-inf\n": "row 2, column min_range: seen -inf",
    "run,crash,min_ttc\n1,0,-1\n": "row 2, column min_ttc: seen -1",
    "run,crash,min_ttc\n1,0,soon\n": "row 2, column min_ttc: seen 'soon'; expected a number",
    "run,crash,impact_speed\n1,0,3\n": "row 2, column impact_speed: seen 3; expected 0 without a crash",
    "run,crash,lead_speed\n1,0,99\n": "row 2, column lead_speed: seen 99",
    "run,crash,host_speed\n1,0,99\n": "row 2, column host_speed: seen 99",
    "run,crash,host_speed\n1,0,fast\n": "row 2, column host_speed: seen 'fast'",
    "run,crash,host_speed\n1,0,2_0\n": "row 2, column host_speed: seen '2_0'",
    "run,hit\n1,0\n": "expected a column crash",
    "run,crash,crash\n1,0,0\n": "column 'crash' twice",
    "": "content that cannot be read",
}


@pytest.mark.parametrize(("table", "message"), WRONG.items())
def test_wrong_results_are_refused_with_the_reason(begun, capsys, table, message):
    begun("ask", "next", "--no-scenarios")
    before = Path("c.json").read_bytes()
    Path("told.csv").write_text(table)
    capsys.readouterr()
    assert begun("tell", "told.csv") == 2
    error = capsys.readouterr().err
    assert message in error
    assert error.count("\n") == 1
    assert Path("c.json").read_bytes() == before


def test_what_was_told_is_not_changed_in_silence(begun, capsys):
    begun("ask", "next", "--no-scenarios")
    first = drive()
    first.head(5).to_csv("part.csv", index=False)
    begun("tell", "part.csv")
    flipped = first.head(1).assign(crash=1 - first["crash"], min_range=np.nan, impact_speed=np.nan)
    flipped.to_csv("other.csv", index=False)
    assert begun("tell", "other.csv") == 2
    assert "add --correct" in capsys.readouterr().err
    assert begun("tell", "other.csv", "--correct") == 0
    assert begun("tell", "part.csv", "--correct") == 0
    first.to_csv("all.csv", index=False)
    begun("tell", "all.csv")
    assert begun("tell", "other.csv", "--correct") == 2  # the sampler has used the batch
    assert "Restore an earlier copy" in capsys.readouterr().err


def test_a_table_that_is_filled_in_by_and_by(begun, capsys):
    begun("ask", "next", "--no-scenarios")
    table = pd.read_csv("next/runs.csv", dtype=str)
    assert begun("tell", "next/runs.csv") == 0
    table.loc[2, ["crash", "note"]] = ["0", "wet road"]
    table.to_csv("next/runs.csv", index=False)
    begun("tell", "next/runs.csv")
    assert "outcomes: 1 new or corrected, 0 known before; 9 runs outstanding" in capsys.readouterr().out
    assert read_campaign("c.json").runs[2].outcome.note == "wet road"


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("--law", "no.json"), "no.json: seen no such file"),
        (("--law", "encounters.parquet"), "expected a complete law file"),
        (("--event", "crush"), "--event: seen 'crush'"),
        (("--event", "min_range"), "--event: seen 'min_range'"),
        (("--event", "min_range=-1"), "--event: seen 'min_range=-1'"),
        (("--half-width", "2"), "--half-width: seen 2"),
        (("--confidence", "0"), "--confidence: seen 0"),
        (("--batch-size", "1"), "--batch-size: seen 1"),
        (("--seed", "-1"), "--seed: seen -1"),
    ],
)
def test_a_campaign_cannot_begin_with_bad_settings(begun, capsys, arguments, message):
    options = ["--law", "law.json", "--encounters", "encounters.parquet", *arguments]
    assert cli.main(["campaign", "new", "other.json", *options]) == 2
    assert message in capsys.readouterr().err
    assert not Path("other.json").exists()


def test_files_that_are_not_what_they_were_are_refused(begun, capsys):
    assert cli.main(["campaign", "status", "none.json"]) == 2
    assert begun("new", "--law", "law.json", "--encounters", "encounters.parquet") == 2
    assert "seen a file; expected no file yet" in capsys.readouterr().err
    begun("ask", "next", "--no-scenarios")
    whole = Path("c.json").read_text()
    for text, message in (
        (whole.replace('"batch": 1', '"batch": 2', 1), "a checksum that does not agree"),
        (whole[:500], "seen no campaign"),
        (whole.replace('"version": 1', '"version": 9', 1), "seen version 9"),
        ("[]", "seen no campaign"),
    ):
        Path("c.json").write_text(text)
        assert begun("status") == 2
        assert message in capsys.readouterr().err
    Path("c.json").write_text(whole)
    law = json.loads(Path("law.json").read_text())
    Path("law.json").write_text(json.dumps(law | {"description": "another"}))
    assert begun("ask", "next", "--no-scenarios", "--again") == 2
    assert "law.json: seen a file that has changed since the campaign began" in capsys.readouterr().err


def test_a_file_keeps_all_of_a_campaign_and_reads_well(begun):
    begun("ask", "next", "--no-scenarios")
    note = 'wet { "number" } road, [ 1 ] Größe'
    drive().assign(note=note).to_csv("done.csv", index=False)
    begun("tell", "done.csv")
    assert read_campaign("c.json").runs[0].outcome.note == note
    text = Path("c.json").read_text()
    write_campaign("copy.json", read_campaign("c.json"))
    assert Path("copy.json").read_text() == text
    lines = [line for line in text.splitlines() if line.startswith('  {"number": ')]
    assert len(lines) == 10
    assert all('"outcome": {"crash": ' in line for line in lines)


def test_an_event_that_is_measured_needs_its_measurement(begun, capsys):
    options = ("--law", "law.json", "--encounters", "encounters.parquet", "--event", "min_range=1")
    assert cli.main(["campaign", "new", "near.json", *options]) == 0
    cli.main(["campaign", "ask", "near.json", "next", "--no-scenarios"])
    Path("told.csv").write_text("run,crash\n1,0\n")
    assert cli.main(["campaign", "tell", "near.json", "told.csv"]) == 2
    assert "it defines the event of this campaign" in capsys.readouterr().err
    drive()
    assert read_results("done.csv", read_campaign("near.json"))
    assert cli.main(["campaign", "tell", "near.json", "done.csv"]) == 0


def test_the_runs_are_scenarios_that_asams_checker_accepts(begun):
    pytest.importorskip("scenariogeneration", reason="the extra `scenarios` is not installed")
    assert begun("ask", "next") == 0
    files = sorted(Path("next").glob("*.xosc"))
    assert [path.stem for path in files] == [f"run_{number:04d}" for number in range(1, 11)]
    assert Path("next/straight_road.xodr").is_file()
    pytest.importorskip("qc_openscenario", reason="ASAM's checker is not installed")
    from asam_checker import verdict

    completed, issues = verdict(files[0])
    assert issues == []
    assert len(completed) >= 15
    broken = files[0].read_text().replace('entityRef="lead"', 'entityRef="leaf"', 1)
    Path("next/broken.xosc").write_text(broken)
    assert verdict(Path("next/broken.xosc"))[1]


def test_the_tutorial_runs_as_it_is_written(tmp_path, monkeypatch):
    """Its commands, in their order, with the loop at its end driven until the campaign may stop."""
    pytest.importorskip("scenariogeneration", reason="the extra `scenarios` is not installed")
    monkeypatch.chdir(tmp_path)
    write_law_folder(tmp_path / "results" / "spmd")
    (tmp_path / "results" / "spmd" / "laws").mkdir()
    Path("results/spmd/law.json").rename("results/spmd/laws/answer.json")
    steps = transcript.commands(TUTORIAL.read_text())
    assert [step[:2] for step in steps[:2]] == [["campaign", "new"], ["campaign", "ask"]]
    last = [step[1] if step[0] == "campaign" else step[0] for step in steps[-4:]]
    assert last == ["ask", "simulate", "tell", "new"]
    told = transcript.drive(TUTORIAL.read_text())
    assert re.search(r"may stop +yes", told)
    assert re.search(r"unseen +a part of .* if a half-space, .* if of any shape \(95% confidence\)", told)
    renewed = transcript.with_transcript(TUTORIAL.read_text(), told)
    assert "".join(f"    {line}\n" for line in told.splitlines()) in renewed
    numbers = transcript.numbers_of(LAW, 1.25e-3).set_index("what")["probability"]
    assert numbers["range_2"] > numbers["range_1"] > numbers["range_0.5"]
    assert numbers["usual"] >= max(numbers["host_speed_50"], numbers["range_0.5"]) > 0
    assert len(re.findall("^    event ", renewed, flags=re.MULTILINE)) == 1
    assert read_campaign("next_car.json").sampler.predecessor.happened.any()
    found = read_campaign("campaign.json").estimate()
    exact = _crude(400_000)
    assert abs(found.probability / exact - 1) < 5 * 0.2 / 1.28
    assert abs(3 * found.probability / exact - 1) > 5 * 0.2 / 1.28  # the wrong variant


def _crude(size):
    """Return the crash probability by drawing from the law; its standard error is about a twentieth."""
    x = LAW.draw(size, np.random.default_rng(5))
    return Problem(CUT_IN, load_vehicle("acc_aeb"), law=LAW).simulate(x).crash.mean()
