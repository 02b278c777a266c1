"""CONTRIBUTING.md, "How to add ...": the toys of tests/toys, which have their own files alone, in a study."""

import json

import numpy as np
import pandas as pd


def test_a_new_method_is_estimated_with_and_compared(finished):
    estimates = pd.read_csv(finished.folder / "results/smoke/estimates.csv")
    assert set(estimates.loc[estimates["method"] == "toy_method", "scope"]) == {"all", "5-15"}
    drawn = pd.read_csv(finished.folder / "figures/smoke/fig20_methods.csv")
    assert "toy_method" in set(drawn["method"])
    assert "toy_method" in (finished.folder / "figures/smoke/tables/surrogate.md").read_text()


def test_a_new_distribution_is_fitted_stored_and_shown(finished):
    law = json.loads((finished.folder / "results/smoke/models/two_pieces.json").read_text())
    tail = law["inverse_ttc"]["distributions"]["5-15"]["components"][-1]
    assert tail["kind"] == "toy exponential"
    chapter = (finished.folder / "results/smoke/book/03_piecewise_mixture_models.html").read_text()
    assert "toy exponential" in chapter


def test_a_new_vehicle_is_mapped_and_simulated(finished):
    (path,) = finished.folder.glob("results/vehicles/toy_car-*/vehicle.json")
    assert json.loads(path.read_text())["vehicle"] == "toy_car"
    compared = pd.read_csv(finished.folder / "results/smoke/laws/vehicles.csv").set_index("vehicle")
    cut_ins = pd.read_parquet(finished.folder / "results/smoke/encounters.parquet")
    # The toy car stops closing in after closing_speed^2 / 6 metres.
    crashes = np.count_nonzero(np.square(cut_ins["closing_speed"]) >= 6 * cut_ins["range"])
    assert compared.loc["toy_car", "recorded"] == crashes
    assert compared.loc["toy_car", "probability"] > compared.loc["under test", "probability"] > 0
