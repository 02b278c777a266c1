"""Probabilities with a limit of the host's speed: exact for exponential closing speeds, and a wrong limit."""

from dataclasses import dataclass
from types import SimpleNamespace

import numpy as np
import pytest
from accelerated_evaluation.answer.ways.host_limit import (
    COLUMNS,
    DRAWN,
    UNLIMITED,
    as_choices,
    host_limit_table,
    host_limits,
    limited_probabilities,
)

LEAD = np.array([5.0, 12.0, 30.0])
FIRST = np.array([10.0, 8.0, 20.0])  # closing speed [m/s] from which on each line has a crash
MEANS = np.array([2.0, 4.0])  # of the exponential closing speeds under the two draws [m/s]


@dataclass(frozen=True)
class ThreeLines:
    """Three lines with one interval each that has no end, and equal shares."""

    row: np.ndarray
    start: np.ndarray
    end: np.ndarray
    places: SimpleNamespace

    def masses(self, draws):
        return draws.masses(self)


class TwoDraws:
    """Two draws of a law whose closing speed is exponential."""

    member = np.zeros(2, int)

    def masses(self, lines):
        return (np.exp(-lines.start / MEANS[:, None]) - np.exp(-lines.end / MEANS[:, None])) / LEAD.size


LINES = ThreeLines(np.arange(3), FIRST, np.full(3, np.inf), SimpleNamespace(lead_speed=LEAD))


def exact(limit, means=MEANS[:, None]):
    """Return the probability under both draws that a host not above the limit crashes, in closed form."""
    last = np.maximum(limit - LEAD, FIRST)
    return (np.exp(-FIRST / means) - np.exp(-last / means)).mean(axis=1)


def test_a_limit_leaves_out_faster_hosts():
    limits = [np.array([25.0]), np.array([18.0, 35.0, 60.0]), np.array([np.inf])]
    found = limited_probabilities(LINES, TwoDraws(), limits)
    assert found[0] == pytest.approx(exact(25.0), rel=1e-9)
    assert found[1] == pytest.approx(np.mean([exact(limit) for limit in limits[1]], axis=0), rel=1e-9)
    assert found[2] == pytest.approx(exact(np.inf), rel=1e-9)
    of_closing_speed = limited_probabilities(
        ThreeLines(LINES.row, FIRST, LINES.end, SimpleNamespace(lead_speed=np.zeros(3))), TwoDraws(), limits
    )
    assert not np.allclose(of_closing_speed[0], exact(25.0), rtol=0.1)


def test_limits_are_those_of_recorded_hosts():
    lead, closing = np.linspace(5, 35, 301), np.tile([1.0, 3.0, 8.0], 101)[:301]
    limits = host_limits(lead, closing)
    highest, two_thirds, quarter = limits.values()
    assert highest == pytest.approx([(lead + closing).max()])
    assert two_thirds.size == quarter.size == DRAWN
    assert np.median(two_thirds) == pytest.approx(np.median((lead + closing)[lead >= 25]), abs=1)
    assert quarter.mean() > two_thirds.mean()
    assert [*limits][1].endswith("25 m/s and more")


def test_table_and_choices():
    lead, closing = np.linspace(5, 35, 301), np.full(301, 3.0)
    table = host_limit_table({"crash": LINES, "impact": LINES}, TwoDraws(), lead, closing)
    assert list(table) == COLUMNS
    own = table[table["event"] == "crash"].set_index("limit")
    assert own.loc[UNLIMITED, "share"] == 1
    assert own.loc[UNLIMITED, "probability"] == pytest.approx(np.mean(exact(np.inf)))
    shares = own["share"].drop(UNLIMITED)
    assert ((shares > 0) & (shares < 1)).all()
    assert shares.iloc[0] == pytest.approx(exact(38.0).mean() / exact(np.inf).mean())
    choices = as_choices(table, "crash")
    assert list(choices["median"]) == list(own["median"].drop(UNLIMITED))
    assert choices["choice"].str.startswith("no host faster than ").all()


def test_without_crashes_the_share_is_not_known():
    none = ThreeLines(LINES.row[:0], FIRST[:0], LINES.end[:0], LINES.places)
    table = host_limit_table({"crash": none}, TwoDraws(), np.linspace(5, 35, 301), np.full(301, 3.0))
    assert table["share"].isna().all()
    assert (table["median"] == 0).all()
