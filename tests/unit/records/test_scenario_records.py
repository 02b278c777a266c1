"""Records of left turns and pedestrians: every row has a verdict, and series give the stored records."""

from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from accelerated_evaluation import SCENARIOS, InputError
from accelerated_evaluation.scenarios.protocol import CLUSTER, FITTED
from accelerated_evaluation.scenarios.record_table import (
    OUTSIDE,
    REPEATED,
    account,
    named_records_of,
    read_scenario_records,
)
from accelerated_evaluation.study.configuration import load

ROOT = Path(__file__).parents[3]
NAMES = ("left_turn", "pedestrian")


def records(name):
    return read_scenario_records(SCENARIOS[name])


@pytest.mark.parametrize("name", [*NAMES, "cut_in"])
def test_the_records_that_a_configuration_names(name, tmp_path):
    config = load(given={"scenario": {"name": name}, "data": {"sample": 500, "spmd": {"outlier_rows": []}}})
    found, kept = named_records_of(SCENARIOS[name], config), []
    raw = found.read(np.random.default_rng(1))
    encounters = found.encounters(raw, kept.append)
    assert len(found.for_checks(raw).valid) == len(raw)
    assert len(kept) == 1
    assert found.exposure(raw).keys() == {"kilometres", "hours"}
    found.write(tmp_path / "encounters.parquet", encounters)
    columns = list(SCENARIOS[name].names)
    written = pd.read_parquet(tmp_path / "encounters.parquet")
    pd.testing.assert_frame_equal(written[columns], encounters[columns])
    shown = config["data"]["spmd"]["path"] if name == "cut_in" else f"records of the scenario {name}"
    assert found.name.startswith(shown)


@pytest.mark.parametrize(
    ("name", "count", "repeated", "clusters"), [(NAMES[0], 1055, 27, 115), (NAMES[1], 983, 0, 27)]
)
def test_every_record_is_fitted_or_left_out_for_a_reason(name, count, repeated, clusters):
    table = records(name)
    counts = account(table)
    assert counts["records"] == len(table) == count
    assert counts[[FITTED, REPEATED, OUTSIDE]].sum() == count
    assert counts[REPEATED] == repeated
    assert counts[OUTSIDE] == 0
    assert table[CLUSTER].nunique() == clusters
    assert all(isinstance(each, str) for each in table[CLUSTER])
    assert table[FITTED].sum() == count - repeated


def test_the_authors_fitted_the_first_1000_left_turns():
    assert np.flatnonzero(records("left_turn")["in_fit"]).tolist() == list(range(1000))


@pytest.mark.parametrize(("name", "crashes", "not_ended"), [("left_turn", 20, 0), ("pedestrian", 3, 1)])
def test_the_car_crashes_in_as_many_records_as_published(name, crashes, not_ended):
    scenario = SCENARIOS[name]
    table = records(name)
    car = scenario.vehicles[scenario.default_vehicle]()
    outcomes = car.simulate(*(table[each] for each in scenario.names))
    assert outcomes.crash.sum() == crashes
    assert (~outcomes.ended & ~outcomes.crash).sum() == not_ended


def records_of_series(series):
    """Return the state at the sample with the smallest distance of each series, 10 samples per second.

    The pedestrian speed is the central difference of the transversal position, one-sided at the ends. Mostly
    the sample is the last one, where the sensor loses the pedestrian whom the vehicle has not yet passed.
    """
    samples = series.assign(distance_m=np.hypot(series["range_m"], series["transversal_m"]))
    groups = samples.groupby("record", sort=False)
    samples["pedestrian_speed_mps"] = groups["transversal_m"].transform(lambda x: np.gradient(x) * 10)
    samples["is_last"] = groups.cumcount(ascending=False) == 0
    return samples.loc[groups["distance_m"].idxmin()].reset_index(drop=True)


def test_series_give_all_stored_records_of_pedestrians():
    series = pd.read_parquet(ROOT / "data/pedestrian/series.parquet")
    stored, computed = records("pedestrian"), records_of_series(series)
    assert computed["record"].tolist() == stored["record"].tolist()
    assert series.groupby("record").size().tolist() == stored["n_samples"].tolist()
    for name in SCENARIOS["pedestrian"].names:
        assert computed[name].to_numpy() == pytest.approx(stored[name].to_numpy(), abs=1e-5)  # 6 digits
    assert computed["is_last"].mean() == pytest.approx(0.86, abs=0.01)


def test_a_user_may_bring_a_table_of_text(tmp_path):
    path = tmp_path / "mine.csv"
    path.write_text(
        "driver,sdv_speed_mps,turning_speed_mps,distance_to_conflict_m\n"
        "a,10.123456789012345,5,40\n"
        "a,10.123456789012345,5,40\n"
        "b,10.123456789012345,5,40\n"
        "b,36,5,40\n"
    )
    table = read_scenario_records(SCENARIOS["left_turn"], path)
    assert table["sdv_speed_mps"][0] == 10.123456789012345
    assert table[FITTED].tolist() == [True, False, True, False]
    assert table[REPEATED].tolist() == [False, True, False, False]
    assert account(table).tolist() == [4, 2, 1, 1]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (
            "driver,sdv_speed_mps,turning_speed_mps\n1,2,3\n",
            "column 'distance_to_conflict_m': seen only the columns",
        ),
        (
            "driver,sdv_speed_mps,turning_speed_mps,distance_to_conflict_m\n1,2,3,4\n1,2,fast,4\n",
            "row 3, column turning_speed_mps: seen 'fast'; expected a finite number",
        ),
        (
            "driver,sdv_speed_mps,turning_speed_mps,distance_to_conflict_m\n1,2,3,\n",
            "row 2, column distance_to_conflict_m: seen nan",
        ),
    ],
)
def test_a_faulty_table_is_one_error(tmp_path, text, message):
    path = tmp_path / "mine.csv"
    path.write_text(text)
    with pytest.raises(InputError, match=message):
        read_scenario_records(SCENARIOS["left_turn"], path)
