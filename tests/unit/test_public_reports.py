"""Faults that users of other public tools reported: the same inputs give the right values here."""

import os
import subprocess
import sys
import zipfile
from functools import partial
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from accelerated_evaluation import VEHICLES, InputError, Stopping, load_vehicle
from accelerated_evaluation.laws.distributions import BoundedExponential, BoundedNormal
from accelerated_evaluation.laws.paper.candidates import fit_candidates, fits_table
from accelerated_evaluation.methods import METHODS
from drone_checks import extract
from scipy import stats
from test_certain_and_impossible_events import From, before

ROOT = Path(__file__).resolve().parents[2]
sys.path.append(str(ROOT / "benchmarks" / "recordings"))

import trajectories  # noqa: E402

# ---------------------------------------------------------------- recordings


def osi():
    """Return betterosi and the writer of traces, or skip the test."""
    betterosi = pytest.importorskip("betterosi", reason="betterosi, the extra 'osi', is not installed")
    import osi_trace

    return betterosi, osi_trace


def write_trace(path, frames, rate=10, **lanes):
    """Write a trace; a frame is a list of vehicles, each a mapping of what differs from a car at 0 m."""
    betterosi, osi_trace = osi()
    car = {"y": 0.0, "width": 4.0, "xVelocity": 0.0, "laneId": 1, "drivingDirection": 2, "class_": "Car"}
    pieces = osi_trace.lane_pieces({1: 0.0, 2: 3.5}, 4, **lanes)
    with betterosi.Writer(str(path)) as writer:
        for number, rows in enumerate(frames):
            made = []
            for row in rows:
                one = osi_trace.vehicle(pd.Series(car | row), 0.0, row.get("field", "newer"))
                if "assigned" in row:
                    one.moving_object_classification = betterosi.MovingObject.MovingObjectClassification(
                        assigned_lane_id=[osi_trace.number(lane) for lane in row["assigned"]],
                        assigned_lane_percentage=row["shares"],
                    )
                made.append(one)
            stamp = betterosi.Timestamp(seconds=number // rate, nanos=10**9 // rate * (number % rate))
            writer.add(betterosi.GroundTruth(timestamp=stamp, moving_object=made, lane=pieces))


@pytest.mark.parametrize("turned", [False, True])
def test_of_two_assigned_lanes_the_one_with_the_larger_percentage_counts(tmp_path, turned):
    """OSI pull request 599: a car on the marking is assigned to both lanes, in either order."""

    def lead(frame):
        own = min(max((frame - 10) / 21, 0), 1)  # share in the lane of the host, above half from frame 21
        order = slice(None, None, -1 if turned else 1)
        lanes, shares = [200, 100][order], [100 - 100 * own, 100 * own][order]
        return {"id": 2, "x": 40.0 + 2.5 * frame, "xVelocity": 25.0, "assigned": lanes, "shares": shares}

    def host(frame):
        return {"id": 1, "x": 3.0 * frame, "xVelocity": 30.0, "assigned": [100], "shares": [100]}

    write_trace(tmp_path / "a.mcap", [[host(frame), lead(frame)] for frame in range(50)])
    (found,) = extract("osi", tmp_path).to_dict("records")
    assert found["time"] == pytest.approx(2.1)
    assert found["range"] == pytest.approx(40 + 2.5 * 21 - 3 * 21 - 4)
    assert found["closing_speed"] == pytest.approx(5.0)


@pytest.mark.parametrize("size", [0.02, 0.2])
def test_a_standing_car_that_jitters_on_a_marking_does_not_cut_in(tmp_path, size):
    """SMARTS issue 1214: the lane of a standing car flips for 1 to 4 frames, 10 a second."""
    generator = np.random.default_rng(3)
    flips = np.repeat(np.arange(60) % 2, generator.integers(1, 5, 60))[:80]
    y = 1.75 + size * np.where(flips, 1.0, -1.0)
    host = {"id": 1, "width": 4.0, "xVelocity": 10.0, "field": None}
    car = {"id": 2, "x": 200.0, "field": None}
    frames = [[host | {"x": 1.0 * frame}, car | {"y": y[frame]}] for frame in range(80)]
    write_trace(tmp_path / "a.mcap", frames, angle=0.0)
    assert extract("osi", tmp_path).empty
    rule = {"rule": {"gap": 0.1, "absence": 0.0, "stay": 0.0}}
    assert not extract(
        "osi", tmp_path, **rule
    ).empty  # without the rule for stays, it cuts in again and again


def test_times_to_collision_of_highd_follow_from_positions_on_both_carriageways(tmp_path):
    """highD-dataset issues 8 and 9: velocities are negative on the upper one, and so is the published TTC."""
    speeds, gap, moment = (32.06, 38.53), 112.62, 100
    rows = []
    for frame in range(1, 201):
        time = (frame - moment) / 25
        fronts = (150 + speeds[0] * time, 150 + gap + 4 + speeds[1] * time)
        for number, (front, speed) in enumerate(zip(fronts, speeds, strict=True), 1):
            lane = 2 if number == 1 or frame >= moment else 3
            row = {"frame": frame, "id": number, "x": 420 - front, "y": 10.0, "width": 4.0, "height": 2.0}
            row |= {"xVelocity": -speed, "laneId": lane, "followingId": int(number == 2), "ttc": -17.38}
            rows.append(row | {"dhw": 0.0})
    tracks = pd.DataFrame(rows).reindex(columns=trajectories.TRACKS.split(","), fill_value=0)
    tracks.to_csv(tmp_path / "01_tracks.csv", index=False)
    meta = pd.DataFrame({"id": [1, 2], "class": "Car", "drivingDirection": 1, "width": 4.0})
    meta = meta.reindex(columns=trajectories.TRACKS_META.split(","), fill_value=0)
    meta.to_csv(tmp_path / "01_tracksMeta.csv", index=False)
    recording = pd.DataFrame([dict.fromkeys(trajectories.RECORDING_META.split(","), 0) | {"frameRate": 25}])
    recording.to_csv(tmp_path / "01_recordingMeta.csv", index=False)
    (found,) = extract("highd", tmp_path).to_dict("records")
    assert found["range"] == pytest.approx(gap)
    assert found["closing_speed"] == pytest.approx(speeds[0] - speeds[1])  # the gap opens
    assert found["range"] / found["closing_speed"] == pytest.approx(-17.4, abs=0.05)


def test_headers_of_round_and_ind_are_refused_with_alternatives(tmp_path):
    """The drone data sets without lanes, as their publisher's tools write the headers."""
    header = (
        "recordingId,trackId,frame,trackLifetime,xCenter,yCenter,heading,width,length,xVelocity,yVelocity"
    )
    header += ",xAcceleration,yAcceleration,lonVelocity,latVelocity,lonAcceleration,latAcceleration\n"
    (tmp_path / "00_tracks.csv").write_text(header + ",".join(["0"] * 17) + "\n")
    (tmp_path / "00_tracksMeta.csv").write_text(
        "recordingId,trackId,initialFrame,finalFrame,numFrames,width,length,class\n0,0,0,0,1,2,4,car\n"
    )
    (tmp_path / "00_recordingMeta.csv").write_text("recordingId,locationId,frameRate\n0,0,25\n")
    with pytest.raises(InputError, match=r"inD, rounD and uniD.* do not say which lane.*(table|source)"):
        extract("exid", tmp_path)


# ---------------------------------------------------------------- vehicles and fits


@pytest.mark.parametrize("name", [name for name in VEHICLES if name not in ("command", "fmu")])
def test_behind_a_faster_lead_there_is_no_time_to_collision(name):
    """esmini issue 569: a follower that falls back reports a positive time to collision."""
    outcomes = load_vehicle(name).simulate([30.0, 20.0], [20.0, 20.0], [-5.0, 0.0])
    assert np.isinf(outcomes.min_ttc).all()
    closing = load_vehicle(name).simulate([20.0], [40.0], [5.0])
    assert 0 < closing.min_ttc[0] <= 8


@pytest.mark.parametrize(
    ("declared", "step", "warns"),
    [("0.02", 0.1, False), ("0.03", 0.1, True), ("0.2", 0.1, True), (None, 0.1, False)],
)
@pytest.mark.parametrize("version", [2, 3])
def test_a_step_that_is_no_multiple_of_the_fmu_s_own_is_reported(tmp_path, version, declared, step, warns):
    """FMPy issue 699: an FMU with a fixed step of its own returns outdated or invalid values."""
    from test_fmu import INPUTS, described

    experiment = f'<DefaultExperiment stepSize="{declared}"/>' if declared else ""
    text = described(version).replace("<ModelVariables>", experiment + "<ModelVariables>")
    place = {2: "linux64", 3: "x86_64-linux"}[version]
    with zipfile.ZipFile(tmp_path / "car.fmu", "w") as archive:
        archive.writestr("modelDescription.xml", text)
        archive.writestr(f"binaries/{place}/car.so", "")
    load = partial(load_vehicle, "fmu", file=str(tmp_path / "car.fmu"), inputs=INPUTS, step=step)
    if not warns:
        load()
        return
    with pytest.warns(UserWarning, match=rf"step of 0\.1 s is no multiple of {declared} s"):
        load()


LEVELS = (np.arange(20_000) + 0.5) / 20_000


def test_truncated_fits_are_within_one_percent():
    """SciPy issues 16382 and 8842: truncnorm.fit and other truncated fits miss their parameters."""
    # truncnorm(a=0, b=3, loc=0.4, scale=0.2), measured from its location
    x = stats.truncnorm(0, 3, 0, 0.2).ppf(LEVELS)
    assert BoundedNormal.fit(x, 0.0, 0.6).sd == pytest.approx(0.2, rel=0.01)
    for rate in (5.0, -5.0, 0.5):
        exact = BoundedExponential(rate, 0.2, 1.0)
        assert BoundedExponential.fit(exact.ppf(LEVELS), 0.2, 1.0).rate == pytest.approx(rate, rel=0.01)


@pytest.mark.parametrize("shape", [0.3, -0.4, 1.5])
def test_generalized_pareto_fits_are_within_one_percent(shape):
    """SciPy issue 20094: genpareto.fit returns values far from the maximum of the likelihood."""
    x = stats.genpareto(shape, 1.0, 0.2).ppf(LEVELS)
    fits = {fit.family: fit for fit in fit_candidates(x, 1.0)}
    found = fits["generalized Pareto"].parameters
    assert found["shape"] == pytest.approx(shape, rel=0.01)
    assert found["scale"] == pytest.approx(0.2, rel=0.01)


def test_a_likelihood_without_a_maximum_never_wins():
    """SciPy issue 20094: below the shape -1, the likelihood grows without limit at the largest value."""
    x = stats.genpareto(-1.5, 1.0, 0.2).ppf(LEVELS[::40])
    table = fits_table(fit_candidates(x, 1.0)).set_index("family")
    assert "shape -1" in table.loc["generalized Pareto", "reason"]
    assert np.isnan(table.loc["generalized Pareto", ["aic", "rank"]].astype(float)).all()
    assert table["rank"].min() == 1


# ---------------------------------------------------------------- the sampler


@pytest.mark.parametrize("batch_size", [1, 5])
@pytest.mark.parametrize(("inverse_ttc", "probability"), [(0.0, 1.0), (np.inf, 0.0)])
def test_events_that_always_or_never_happen(batch_size, inverse_ttc, probability):
    """OpenTURNS issues 1405 and 1592: subset sampling fails for a probability of 1, or never ends."""
    sampler = METHODS["surrogate"](batch_size=batch_size)
    found = sampler.estimate(
        before(From(inverse_ttc)), Stopping(maximum_simulations=40), np.random.default_rng(1)
    )
    assert found.probability == probability
    assert found.low <= probability <= found.high
    assert found.low < found.high
    assert found.simulations <= 40


class Fenced(From):
    """A car that ends the run outside of the domain of its law."""

    def simulate(self, lead_speed, range_, closing_speed):
        inside = (
            (lead_speed == 20) & (range_ > 0) & (range_ <= 75) & (closing_speed >= 0) & (closing_speed <= 24)
        )
        if not inside.all():
            raise ValueError("outside of the domain")
        return super().simulate(lead_speed, range_, closing_speed)


@pytest.mark.parametrize("batch_size", [1, 5])
def test_no_input_outside_of_the_law_is_simulated(batch_size):
    """OpenTURNS issue 1405: importance sampling around a design point passes negative counts to the model."""
    sampler, problem = METHODS["surrogate"](batch_size=batch_size), before(Fenced(0.5), cap=24.0)
    found = sampler.estimate(problem, Stopping(maximum_simulations=80), np.random.default_rng(2))
    assert found.events > 0


# ---------------------------------------------------------------- the computer


@pytest.mark.studies
def test_nothing_needs_a_writable_home(tmp_path):
    """A home folder on a read-only disk, and a package in a folder that is not writable either."""
    program = """
import pkgutil, importlib, sys
import numba.core.caching as caching
def refuse(self):
    raise OSError("read-only")
caching.InTreeCacheLocator.ensure_cache_path = refuse
import accelerated_evaluation
for module in pkgutil.walk_packages(accelerated_evaluation.__path__, "accelerated_evaluation."):
    importlib.import_module(module.name)
from accelerated_evaluation import cli
sys.exit(cli.main(["simulate", "in.csv", "out.csv"]))
"""
    (tmp_path / "in.csv").write_text("lead_speed,range,closing_speed\n20,10,8\n")
    environment = {"PATH": os.environ["PATH"], "HOME": "/dev/null", "PYTHONDONTWRITEBYTECODE": "1"}
    environment["MPLCONFIGDIR"] = str(tmp_path)  # Matplotlib itself warns, and then uses a temporary folder
    done = subprocess.run(
        [sys.executable, "-c", program],
        cwd=tmp_path,
        env=environment,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "out.csv").read_text().count("\n") == 2
