"""Plain importance sampling of cut-ins, against a law whose probabilities are known in closed form."""

import sys
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

sys.path.append(str(Path(__file__).resolve().parents[1]))

import second_ways

FAR, CAP = 75.0, 45.0
SPEEDS = np.linspace(5, 35, 1001)
MEANS = np.array([1.0, 1.5])  # of the exponential closing speed, one for each law


def density(x):
    """The range is uniform, and the closing speed exponential, with the rest of its mass at the cap."""
    closing, rate = x[:, 2], 1 / MEANS[:, None]
    below = np.log(rate) - rate * closing
    return np.where(closing >= CAP, -rate * CAP, below) - np.log(FAR)


def features(x):
    return {"events": ((x[:, 2] > 15) & (x[:, 1] < 10))[:, None]}


def made(means):
    return {"probabilities": pd.DataFrame({"probability": means["events"][:, 0]})}


@pytest.mark.parametrize("wrong", [1.0, 1.5])
def test_a_rare_event_has_its_probability(monkeypatch, wrong):
    """The second value is that of a density which is half as large again, and has to be found out."""
    monkeypatch.setattr(second_ways, "SIZE", 2**13)
    wide = second_ways.WideCutIns(SPEEDS, FAR, CAP)
    plain = second_ways.Plain.of(
        wide, lambda x: density(x) + np.log(wrong), features, np.random.default_rng(2)
    )
    ((_, table, errors),) = plain.tables(made)
    exact = np.exp(-15 / MEANS) * (10 - second_ways.NEAREST) / FAR
    off = np.abs(table["probability"] - exact) / errors["probability"]
    assert (errors["probability"] < 0.05 * exact).all()
    assert (off < 4).all() if wrong == 1 else (off > 4).all()
