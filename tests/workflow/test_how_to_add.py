"""Extensions of a study: the toys of tests/toys, which are in a folder of their user, in a study."""

import json
import subprocess
import sys

import numpy as np
import pandas as pd
import pytest


def test_a_new_method_is_estimated_with_and_compared(finished):
    estimates = pd.read_csv(finished.folder / "results/smoke/estimates.csv")
    assert set(estimates.loc[estimates["method"] == "toy_method", "scope"]) == {"all", "5-15"}
    assert set(estimates.loc[estimates["method"] == "toy_method", "estimating"]) == {900}  # its own setting
    drawn = pd.read_csv(finished.folder / "figures/smoke/fig20_methods.csv")
    assert "toy_method" in set(drawn["method"])
    assert "toy method" in (finished.folder / "figures/smoke/tables/surrogate.md").read_text()


def test_a_new_distribution_is_fitted_stored_and_shown(finished):
    law = json.loads((finished.folder / "results/smoke/models/two_pieces.json").read_text())
    tail = law["inverse_ttc"]["distributions"]["5-15"]["components"][-1]
    assert tail["kind"] == "toy exponential"
    chapter = (finished.folder / "results/smoke/book/06_piecewise_models.html").read_text()
    assert "toy exponential" in chapter


def test_a_new_joint_law_is_scored_and_weighted_for_cut_ins(finished):
    laws = pd.read_csv(finished.folder / "results/smoke/laws/laws.csv").set_index("law")
    added, weights = laws.loc["toy copula"], laws["weight"].drop("all laws, weighted")
    assert added.filter(like="gain_").notna().all()
    assert added["impossible"] == 0
    assert 0 < weights["toy copula"] < 1
    assert weights.sum() == pytest.approx(1)
    # A Gaussian copula and the smooth laws agree on the crashes to some orders of magnitude.
    smooth = laws["probability"].drop(["toy copula", "all laws, weighted"]).dropna()
    assert smooth.min() / 100 < added["probability"] < smooth.max() * 100


def test_a_new_vehicle_is_mapped_and_simulated(finished):
    (path,) = finished.folder.glob("results/vehicles/toy_car-*/vehicle.json")
    assert json.loads(path.read_text())["vehicle"] == "toy_car"
    compared = pd.read_csv(finished.folder / "results/smoke/laws/vehicles.csv").set_index("vehicle")
    cut_ins = pd.read_parquet(finished.folder / "results/smoke/encounters.parquet")
    # The toy car stops closing in after closing_speed^2 / 6 metres.
    crashes = np.count_nonzero(np.square(cut_ins["closing_speed"]) >= 6 * cut_ins["range"])
    assert compared.loc["toy_car", "recorded"] == crashes
    assert compared.loc["toy_car", "probability"] > compared.loc["under test", "probability"] > 0


def test_a_figure_of_a_users_module_is_drawn(finished):
    drawn, answer = (
        pd.read_csv(finished.folder / path)
        for path in ("figures/smoke/toy_figure.csv", "results/smoke/laws/answer.csv")
    )
    assert drawn["event"].tolist() == answer["event"].tolist()
    np.testing.assert_allclose(drawn["probability"], answer["probability"], rtol=1e-5)
    assert (finished.folder / "figures/smoke/toy_figure.png").read_bytes().startswith(b"\x89PNG")
    page = (finished.folder / "results/smoke/book/added_figures.html").read_text()
    assert "Draw the probability of each event of the answer." in page
    assert "toy_figure.png" in page
    assert "draw_toy_figure" in page
    assert "added_figures.html" in (finished.folder / "results/smoke/book/index.html").read_text()


def test_a_new_source_is_read_and_a_new_law_fitted_and_simulated(finished, tmp_path):
    generator = np.random.default_rng(1)
    rows = pd.DataFrame(
        {
            "lead_speed": generator.uniform(2, 10, 600),
            "range": 1 / (0.015 + generator.exponential(0.02, 600)),
            "closing_speed": generator.exponential(1, 600),
        }
    )
    rows.to_csv(tmp_path / "records.csv", header=False, index=False)
    settings = {
        "study": "toy",
        "modules": [
            str(finished.folder / f"mine/{name}.py") for name in ("toy_source", "toy_law", "toy_car")
        ],
        "data": {"source": "toy_source", "toy_source": {"path": "records.csv", "speed_unit": 2}},
        "vehicle": {"name": "toy_car"},
        "importance_sampling": {"beta": 0.5},
    }
    (tmp_path / "toy.yaml").write_text(json.dumps(settings))
    command = [sys.executable, "-m", "accelerated_evaluation.cli", "estimate", "--config", "toy.yaml"]
    command += ["--law", "toy_law"]
    run = subprocess.run(command, cwd=tmp_path, env=finished.environment, capture_output=True, text=True)
    assert run.returncode == 0, run.stderr[-5000:]
    law = json.loads((tmp_path / "results/toy/estimate/law.json").read_text())
    assert law["kind"] == "toy_law"
    assert sum(law["counts"].values()) == len(rows)
    estimate = pd.read_csv(tmp_path / "results/toy/estimate/estimate.csv")
    assert estimate["law"].tolist() == ["a toy"]
    # The toy car crashes if closing_speed^2 / 6 >= range, so if TTC^-1 >= sqrt(6 R^-1).
    ranges = law["inverse_range"]["distribution"]
    (speeds,) = law["inverse_ttc"]["distributions"].values()
    u = (np.arange(100_000) + 0.5) / 100_000
    inverse_range = ranges["lower"] * u ** (-1 / ranges["shape"])
    exact = np.exp(-speeds["rate"] * np.sqrt(6 * inverse_range)).mean()
    assert 0.5 < estimate["probability"].item() / exact < 2  # the interval is one of 50 % on both sides
