"""Tests that a regulation prescribes for a scenario: encounters in which a vehicle must not crash."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import pandas as pd

from accelerated_evaluation.base.arrays import Array


@dataclass(frozen=True)
class PrescribedTest:
    """A test of a regulation, passed by a vehicle that crashes in none of its encounters."""

    name: str
    source: str  # regulation and paragraph
    encounters: Array  # shape (n, d), with the variables of the scenario as columns


def prescribed_table(tests: tuple[PrescribedTest, ...], crashes: Mapping[str, Array]) -> pd.DataFrame:
    """Tabulate which vehicles pass which tests, one row for each vehicle and test.

    ``crashes`` has whether each encounter of all tests, one after the other, ended in a crash, by vehicle.
    """
    ends = np.cumsum([len(test.encounters) for test in tests])[:-1]
    rows = [
        {
            "vehicle": vehicle,
            "test": test.name,
            "source": test.source,
            "encounters": len(test.encounters),
            "crashes": int(part.sum()),
            "passed": not part.any(),
        }
        for vehicle, crashed in crashes.items()
        for test, part in zip(tests, np.split(crashed, ends), strict=True)
    ]
    return pd.DataFrame(rows, columns=["vehicle", "test", "source", "encounters", "crashes", "passed"])
