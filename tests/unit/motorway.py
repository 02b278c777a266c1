"""Cut-ins as on a motorway: lead speeds of 20 to 45 m/s and ranges up to 150 m."""

from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from accelerated_evaluation.study.configuration import load

CONFIGURATION = """\
study: motorway
data:
  source: table
  table:
    description: generated cut-ins on a motorway
    path: data/motorway.csv
    columns:
      lead_speed: {name: v_lead, unit: km/h}
      range: {name: gap, unit: m}
      closing: {name: range_rate, quantity: range_rate, unit: m/s}
"""


def motorway_table(size: int = 12_000, seed: int = 7) -> pd.DataFrame:
    """Draw cut-ins in the columns and units that `CONFIGURATION` states."""
    generator = np.random.default_rng(seed)
    lead_speed = 20 + 25 * generator.beta(2.5, 2.5, size)
    range_ = 150 * generator.beta(2, 1.2, size).clip(0.02)
    closing_speed = generator.exponential(0.5 + 0.022 * range_)
    columns = {"v_lead": 3.6 * lead_speed, "gap": range_, "range_rate": -closing_speed}
    return pd.DataFrame(columns).round(4)


@pytest.fixture(name="motorway")
def motorway_(tmp_path, monkeypatch):
    """Return the stated configuration of the generated motorway, whose table lies in the working folder."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "data").mkdir()
    motorway_table().to_csv("data/motorway.csv", index=False)
    Path("motorway.yaml").write_text(CONFIGURATION)
    return load(["motorway.yaml"])
