"""The data of the explorer: the numbers of its vehicles, rates, and text that is safe in a page."""

import numpy as np
import pytest
from accelerated_evaluation.base.errors import StudyError
from accelerated_evaluation.publishing.explorer import vehicles
from accelerated_evaluation.publishing.explorer.page import Payload, rate_quantiles
from accelerated_evaluation.scenarios import SCENARIOS
from accelerated_evaluation.scenarios.cut_in import CUT_IN


def test_the_page_puts_every_slider_at_the_vehicle_of_the_study():
    tested = {"name": "acc_aeb", "parameters": {"aeb_ttc": 1.23, "aeb_release_ttc": 1.4, "headway": 1.55}}
    own = vehicles.described_vehicles(CUT_IN, tested)[0]
    starts = {slider["name"]: slider["stops"][slider["start"]] for slider in own["sliders"]}
    assert starts["aeb_ttc"]["value"] == "1.23"
    assert starts["headway"]["value"] == "1.55"
    assert all(not stop["changes"] for stop in starts.values())


def test_sliders_together_give_the_numbers_of_the_vehicle():
    for scenario, described in [
        (each, described)
        for each in (CUT_IN, SCENARIOS["left_turn"])
        for described in vehicles.described_vehicles(each, {"name": "other", "parameters": {}})
    ]:
        vehicle_class = scenario.vehicles[described["name"]]
        base = {name: getattr(vehicle_class(), name) for name in vehicles.parameter_names(vehicle_class)}
        numbers, parameters = dict(described["numbers"]), base
        for slider, stops in zip(vehicles.SLIDERS[described["name"]], described["sliders"], strict=True):
            numbers |= stops["stops"][-1]["changes"]
            published = getattr(vehicle_class, "published_ttc", (0.0, 0.0))
            parameters = slider.parameters(parameters, slider.values(base[slider.parameter], published)[-1])
        found = {name: float(text) for name, text in numbers.items()}
        assert found == vehicle_class(**parameters).compiled()._asdict()


def test_two_sliders_of_one_number_are_an_error(monkeypatch):
    twice = (vehicles.HEADWAY, vehicles.HEADWAY)
    monkeypatch.setitem(vehicles.SLIDERS, "acc_only", twice)
    with pytest.raises(StudyError, match="same number"):
        vehicles.described_vehicles(CUT_IN, {"name": "acc_aeb", "parameters": {}})


def test_without_kilometres_there_are_no_rates():
    assert rate_quantiles(100, {"kilometres": None, "hours": 3.0})["rates"] is None
    rates = rate_quantiles(100, {"kilometres": 50.0})["rates"]
    assert np.mean(rates) == pytest.approx(2e6, rel=0.02)  # 100.5 cut-ins in 50 km, from 15 quantiles


def test_text_cannot_end_the_script_that_holds_it():
    payload = Payload({"study": "</script><b>"})
    payload.add("values", [1, 2], "u2")
    assert "<" not in payload.json
    bad = Payload({"bad": float("nan")})
    with pytest.raises(ValueError, match="not JSON compliant"):
        str(bad.json)
