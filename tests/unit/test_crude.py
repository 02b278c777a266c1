"""Crude Monte Carlo: a known probability, and the same bytes however often it is killed."""

import math
from dataclasses import dataclass, field

import numpy as np
import pytest
from accelerated_evaluation import CUT_IN, Problem
from accelerated_evaluation.base.files import write_csv
from accelerated_evaluation.laws.distributions import BoundedExponential, Empirical
from accelerated_evaluation.laws.paper.models import IndependentLaw
from accelerated_evaluation.methods.crude import (
    Checkpoint,
    crude_course,
    crude_estimates,
    fingerprint,
    simulate_batches,
)
from accelerated_evaluation.vehicles.protocol import Outcomes

THRESHOLD = 0.3
SPEEDS = Empirical([10.0, 12.0])
LAW = IndependentLaw(
    "toy",
    {"slow": 600, "fast": 400},
    BoundedExponential(80.0, 1 / 75),
    {"slow": BoundedExponential(10.0), "fast": BoundedExponential(15.0)},
    {"slow": SPEEDS, "fast": SPEEDS},
)
SETTINGS = {"seed": 7, "batches": 12, "batch_size": 2000, "save_every": 3}


@dataclass
class Toy:
    """Crashes where TTC^-1 exceeds a threshold; breaks down at a call chosen beforehand."""

    breaks_at: float = math.inf
    calls: int = field(default=0)

    def simulate(self, lead_speed, range_, closing_speed):
        self.calls += 1
        if self.calls == self.breaks_at:
            raise KeyboardInterrupt
        zeros = np.zeros(range_.size)
        return Outcomes(closing_speed / range_ > THRESHOLD, zeros, zeros, zeros)


def run(folder, vehicle, work="one", **settings):
    checkpoint = Checkpoint(folder / "checkpoint.json", work)
    return simulate_batches(Problem(CUT_IN, vehicle, law=LAW), checkpoint, **(SETTINGS | settings))


def written(folder, batches):
    write_csv(folder / "estimates.csv", crude_estimates(batches, 0.2))
    write_csv(folder / "course.csv", crude_course(batches, 0.2))
    return (folder / "estimates.csv").read_bytes() + (folder / "course.csv").read_bytes()


def test_the_estimate_is_the_probability_within_its_error(tmp_path):
    table = crude_estimates(run(tmp_path, Toy(), batch_size=50_000), 0.2).set_index("segment")
    exact = {"slow": math.exp(-10 * THRESHOLD), "fast": math.exp(-15 * THRESHOLD)}
    exact["all"] = 0.6 * exact["slow"] + 0.4 * exact["fast"]
    for segment, probability in exact.items():
        row = table.loc[segment]
        error = math.sqrt(probability * (1 - probability) / row["simulations"])
        assert abs(row["probability"] - probability) < 4 * error
    assert table.loc["all", "simulations"] == 600_000
    share = table.loc["slow", "simulations"] / 600_000
    assert abs(share - 0.6) < 4 * math.sqrt(0.6 * 0.4 / 600_000)


@pytest.mark.parametrize("breaks_at", [1, 2, 5, 7, 12])
def test_killed_and_resumed_it_ends_with_the_same_bytes(tmp_path, breaks_at):
    whole = written(tmp_path, run(tmp_path / "whole", Toy()))
    with pytest.raises(KeyboardInterrupt):
        run(tmp_path / "killed", Toy(breaks_at))
    second = Toy()
    resumed = run(tmp_path / "killed", second)
    assert written(tmp_path, resumed) == whole
    finished = breaks_at - 1  # batches, of one call each
    assert second.calls == SETTINGS["batches"] - finished + finished % SETTINGS["save_every"]


def test_it_can_be_extended_and_shortened(tmp_path):
    whole = run(tmp_path / "whole", Toy())
    run(tmp_path, Toy(), batches=5)
    assert run(tmp_path, Toy()) == whole
    idle = Toy()
    assert run(tmp_path, idle, batches=4) == whole[:4]
    assert idle.calls == 0


def test_batches_differ(tmp_path):
    batches = [str(counts) for counts in run(tmp_path, Toy())]
    assert len(set(batches)) == len(batches)


def test_the_checkpoint_of_another_work_is_not_used(tmp_path):
    run(tmp_path, Toy(), work="one", seed=8)
    with pytest.warns(UserWarning, match="all batches are simulated again"):
        again = run(tmp_path, Toy(), work="two")
    assert again == run(tmp_path / "fresh", Toy())


@pytest.mark.parametrize("damage", ["", "{}", "[1]", "null", "half", "digit", "bytes"])
def test_a_damaged_checkpoint_is_told_and_not_used(tmp_path, damage):
    whole = run(tmp_path, Toy())
    path = tmp_path / "checkpoint.json"
    text = path.read_text()
    damaged = {
        "half": text[: len(text) // 2],
        "digit": text.replace(str(whole[0]["slow"][1]), str(whole[0]["slow"][1] + 1), 1),
    }
    path.write_bytes(b"\xff\xfe" if damage == "bytes" else damaged.get(damage, damage).encode())
    with pytest.warns(UserWarning, match=r"checkpoint.json is damaged; all batches are simulated again"):
        assert run(tmp_path, Toy()) == whole


def test_the_fingerprint_changes_with_files_and_settings(tmp_path):
    path = tmp_path / "model.json"
    path.write_text("one")
    first = fingerprint([path], {"seed": 1, "batch_size": 5})
    assert fingerprint([path], {"batch_size": 5, "seed": 1}) == first
    assert fingerprint([path], {"seed": 2, "batch_size": 5}) != first
    path.write_text("two")
    assert fingerprint([path], {"seed": 1, "batch_size": 5}) != first


def test_a_segment_without_a_crash_has_an_upper_bound_alone():
    table = crude_estimates([{"a": [600, 0], "b": [400, 3]}, {"a": [400, 0], "b": [600, 1]}], 0.2)
    safe, _, every = table.to_dict("records")
    assert (safe["simulations"], safe["crashes"], safe["probability"], safe["ci_low"]) == (1000, 0, 0, 0)
    assert safe["ci_high"] == pytest.approx(1 - 0.1 ** (1 / 1000), rel=1e-10)
    assert safe["ci95_high"] == pytest.approx(1 - 0.025 ** (1 / 1000), rel=1e-10)
    assert (every["segment"], every["simulations"], every["crashes"]) == ("all", 2000, 4)
    assert every["ci95_low"] < every["ci_low"] < every["probability"] < every["ci_high"] < every["ci95_high"]


def test_the_course_ends_at_the_estimate(tmp_path):
    batches = run(tmp_path, Toy())
    course, estimates = crude_course(batches, 0.2), crude_estimates(batches, 0.2)
    assert course["simulations"].tolist() == [2000 * k for k in range(1, 13)]
    assert course.iloc[-1].to_dict() == estimates.iloc[-1][course.columns].to_dict()
