"""Limits that follow the records, and the smooth laws within them."""

import json
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from accelerated_evaluation import SOURCES, InputError, cli
from accelerated_evaluation.answer import estimation as alone
from accelerated_evaluation.laws.smooth.family import DistinctRecords, Fitter, members_at
from accelerated_evaluation.laws.smooth.support import Support
from accelerated_evaluation.records.limits import AUTO, AUTOMATIC, edges_of, limits_in_words, limits_of
from accelerated_evaluation.study.configuration import ConfigurationError, completed, load, resolved, validate
from accelerated_evaluation.study.limits import value_of, with_limits, with_values
from motorway import motorway_, motorway_table  # noqa: F401

ROOT = Path(__file__).resolve().parents[3]


def derived(raw, config):
    """Return the limits that a configuration does not state, and those that it states."""
    return limits_of(raw, {key: value_of(config, key) for key in AUTOMATIC}, config["data"])


def test_the_paper_keeps_its_limits():
    config = load()
    assert [value_of(config, key) for key in AUTOMATIC][:4] == [5, 35, 75, [5, 15, 25, 35]]
    assert resolved(config) == config


def test_the_rules_would_give_the_paper_its_own_limits():
    config = load()
    raw = SOURCES["spmd"].read(config["data"]["spmd"] | {"path": ROOT / config["data"]["spmd"]["path"]})
    limits = limits_of(raw, dict.fromkeys(AUTOMATIC, AUTO), config["data"])
    for key in (*AUTOMATIC[:4], "sensitivity.lead_speed_edges"):
        assert limits[key] == value_of(config, key)
    assert limits["models.closing_speed_max"] == pytest.approx(23.49, abs=0.05)


def test_other_records_get_limits_of_their_own(motorway):
    assert {value_of(motorway, key) for key in AUTOMATIC} == {AUTO}
    config = resolved(motorway)
    assert config["filters"] == {"lead_speed_min": 20, "lead_speed_max": 45, "range_max": 150}
    edges = config["segments"]["lead_speed_edges"]
    assert (edges[0], edges[-1]) == (20, 45)
    assert config["crash_map"]["grid"]["closing_speed_max"] == config["models"]["closing_speed_max"]
    assert "20 to 45 m/s" in limits_in_words(config["filters"], edges, config["models"]["closing_speed_max"])


def test_the_estimate_alone_has_the_limits_of_the_records(motorway, monkeypatch):
    """The command ``estimate`` is given them in place of ``auto``, as the study is."""
    seen = []

    def stop(settings, request):
        seen.append(settings.records.filters)
        raise InputError("here", seen="enough", expected="no more", change="Nothing.")

    monkeypatch.setattr(alone, "estimate_event", stop)
    assert cli.main(["estimate", "--config", "motorway.yaml"]) == 2
    assert seen[0] == resolved(motorway)["filters"]
    assert AUTO not in seen[0].values()


def test_what_is_stated_stays(motorway):
    config = with_values(motorway, {"filters.lead_speed_max": 40, "models.closing_speed_max": 50})
    found = resolved(config)
    assert found["filters"]["lead_speed_max"] == found["segments"]["lead_speed_edges"][-1] == 40
    assert found["models"]["closing_speed_max"] == found["crash_map"]["grid"]["closing_speed_max"] == 50


def test_a_value_that_does_not_fit_the_records_is_told(motorway):
    with pytest.raises(ConfigurationError, match="edges that begin"):
        resolved(with_values(motorway, {"segments.lead_speed_edges": [5, 15, 25, 35]}))


@pytest.mark.parametrize("data", [{"source": "spmd"}, None, {"sample": 500}, "table"])
def test_only_another_source_has_automatic_limits(data):
    assert completed({"data": data})["filters"]["range_max"] == 75


def test_limits_are_kept_as_long_as_the_records_are_the_same(motorway, tmp_path, monkeypatch):
    kept, files = tmp_path / "limits.json", ["data/motorway.csv"]
    first = with_limits(motorway, files, kept)
    read = []
    monkeypatch.setattr(
        "accelerated_evaluation.study.limits.read_source", lambda *_: read.append(1) or motorway_raw()
    )
    assert with_limits(motorway, files, kept) == first
    assert read == []
    with open("data/motorway.csv", "a") as file:
        file.write("100,50,-2\n")
    with_limits(motorway, files, kept, trust=True)
    assert read == []
    with_limits(motorway, files, kept)
    assert read == [1]
    assert set(json.loads(kept.read_text())["limits"]) == set(AUTOMATIC)
    for damage in ('{"of": ', "[]", "null"):
        kept.write_text(damage)
        with_limits(motorway, files, kept)
        assert set(json.loads(kept.read_text())["limits"]) == set(AUTOMATIC)


def motorway_raw():
    table = motorway_table(500)
    columns = {"lead_speed": table["v_lead"] / 3.6, "range": table["gap"], "range_rate": table["range_rate"]}
    return pd.DataFrame(columns)


def test_impossible_rows_do_not_stretch_the_limits(motorway):
    raw = motorway_raw()
    raw.loc[3, "range"], raw.loc[4, "lead_speed"], raw.loc[5, "range"] = 999.0, 120.0, -1.0
    assert derived(raw, motorway)["filters.range_max"] == 150
    assert derived(raw, motorway)["filters.lead_speed_max"] <= 45


def test_records_with_the_wrong_sign_get_limits_so_that_the_report_can_tell(motorway):
    limits = derived(motorway_raw(), motorway)
    assert derived(motorway_raw().assign(range_rate=lambda rows: -rows["range_rate"]), motorway) == limits


def test_without_a_number_the_study_ends_with_one_message(motorway):
    with pytest.raises(InputError, match="none of them with three valid numbers"):
        derived(motorway_raw().assign(range_rate=np.nan), motorway)


def test_thin_segments_are_joined():
    speeds = pd.Series(np.concatenate([np.linspace(5, 14.9, 1000), np.linspace(15, 24.9, 20), [30.0] * 700]))
    assert edges_of(speeds, 5, 35, 10, 600) == [5, 15, 35]
    assert edges_of(speeds[:100], 5, 35, 10, 600) == [5, 35]
    assert edges_of(speeds, 5, 35, 10, 1) == [5, 15, 25, 35]
    assert edges_of(speeds, 5, 6, 10, 600) == [5, 6]


def test_auto_is_a_value_and_other_words_are_none(motorway):
    validate(motorway)
    with pytest.raises(ConfigurationError, match='range_max: seen "automatic"; expected number >= 1'):
        validate(with_values(motorway, {"filters.range_max": "automatic"}))


def test_the_smooth_laws_tell_speeds_and_ranges_beyond_the_paper_apart():
    """Closing speeds here have the mean 1 + (v_L - 20) / 5 + R / 75, also above 35 m/s and 75 m."""
    generator = np.random.default_rng(4)
    lead_speed, range_ = generator.uniform(20, 45, 6000), 150 * generator.uniform(0, 1, 6000) ** 0.5
    closing = generator.exponential(1 + (lead_speed - 20) / 5 + range_ / 75)

    def ratio(support):
        """Median closing speed at 44 m/s over that at 36 m/s."""
        events = DistinctRecords(lead_speed, range_, closing, support)
        body = Fitter(events, members_at((0.9,))).fit().body
        at = DistinctRecords(np.array([36.0, 44.0]), np.array([140.0, 140.0]), np.zeros(2), support)
        low, high = at.places.body(body).inverse(np.log(2))
        return high / low

    exact = (1 + 24 / 5 + 140 / 75) / (1 + 16 / 5 + 140 / 75)
    # A median of 500 records of an exponential law is known within 6.5 %, a ratio within 9 %.
    assert ratio(Support((20.0, 45.0), 150.0, 40.0)) == pytest.approx(exact, rel=0.09)
    assert ratio(Support((5.0, 35.0), 150.0, 40.0)) == pytest.approx(1, abs=0.01)  # the paper's speeds: blind


def test_limits_between_which_there_is_no_record_are_refused(motorway):
    motorway["filters"]["lead_speed_min"] = 99
    with pytest.raises(InputError, match="contains the lead speed of no record"):
        resolved(motorway)
