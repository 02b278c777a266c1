"""Studies of other scenarios than the cut-in, in miniature; and one from a folder of its user."""

import json
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from accelerated_evaluation.base.extensions import VARIABLE
from accelerated_evaluation.scenarios import SCENARIOS
from scipy.stats import norm

ROOT = Path(__file__).resolve().parents[2]
MINIATURE = """
study: {0}
scenario: {{name: {0}, records: {1}, draws: 20, simulations: 60000}}
importance_sampling: {{replicates: 1, beta: 0.5, minimum_events: 5}}
surrogate: {{replicates: 1, maximum_calls: 100}}
"""


@pytest.mark.studies
@pytest.mark.parametrize("name", ["left_turn", pytest.param("pedestrian", marks=pytest.mark.rest)])
def test_a_study_of_a_scenario_completes_and_a_second_run_does_nothing(project, name):
    """Both answer; one is followed to its book, which is made of the same notebooks.

    The laws of that one are fitted to every fourth record, because fits to all records take most of its time.
    """
    records = SCENARIOS[name].records.file
    if name == "left_turn":
        pd.read_parquet(ROOT / records)[::4].to_parquet(project.folder / "few.parquet")
        records = "few.parquet"
    (project.folder / "mini.yaml").write_text(MINIATURE.format(name, records))
    tables = "laws/answer", "scenario/agreement", "scenario/estimates"
    only = [f"results/{name}/{table}.csv" for table in tables]
    done = project.run(*([] if name == "left_turn" else only), config="mini.yaml")
    assert done.returncode == 0, done.stdout + done.stderr
    results, figures = (project.folder / folder / name for folder in ("results", "figures"))
    answer = pd.read_csv(results / "laws/answer.csv")
    may_not_happen = "impact speed above 10 m/s" if name == "left_turn" else "impact speed"  # in so few runs
    is_rare = answer["event"].str.startswith(may_not_happen)
    assert answer.loc[~is_rare, "median"].notna().all()
    answer = answer.dropna(subset="median")
    assert (answer["low80"] <= answer["median"]).all()
    assert (answer["median"] <= answer["high80"]).all()
    agreement = pd.read_csv(results / "scenario/agreement.csv").set_index("kind")
    assert agreement.loc["firm", "agree"] >= 0.999 * agreement.loc["firm", "verdicts"]
    if name != "left_turn":
        return
    assert (figures / "fig35_scenario_methods.png").is_file()
    page = (results / "book/index.html").read_text()
    assert page.count("<h1") == len(re.findall(r"<h1>A crash in one of [\d,]+ encounters", page)) == 1
    assert "How severe?" in page
    assert "explorer.html" in page
    speeds = pd.read_csv(results / "laws/impact_speeds.csv").set_index("of")["impact_speed_m_s"]
    assert 0 <= speeds["q10"] <= speeds["q50"] <= speeds["q90"] < 60
    explorer = (results / "book/explorer.html").read_text()
    assert '"kernel": "turn"' in explorer
    assert "Mixtures of truncated normal distributions" in explorer
    chapters = {path.name[:2] for path in (results / "book").glob("[0-9]*.html")}
    assert chapters == {
        "02",
        "03",
        "04",
        "10",
        "91",
    }  # a left turn has no paper, no replays and no counted crashes
    assert (
        "No curves of the risk of injury are known"
        in (results / "book/04_vehicles_humans_and_injuries.html").read_text()
    )
    again = project.run("--dry-run", config="mini.yaml")
    assert "Nothing to be done" in again.stdout + again.stderr


def run(tmp_path, environment, *commands):
    """Run commands one after another in one process."""
    lines = [
        "from accelerated_evaluation.cli import main",
        *(f"assert main({each}) == 0" for each in commands),
    ]
    command = [sys.executable, "-c", "\n".join(lines)]
    done = subprocess.run(command, cwd=tmp_path, env=environment, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr[-3000:]
    return done.stdout


@pytest.mark.studies
def test_a_scenario_a_law_and_a_check_of_a_users_folder_are_used_by_all_commands(tmp_path):
    """Commands without a configuration find the modules by the environment variable."""
    shutil.copytree(ROOT / "tests/toys/mine", tmp_path / "mine")
    guide = (ROOT / "docs/your_scenario.md").read_text(encoding="utf-8")
    blocks = dict(re.findall(r"```python\n# (\S+)\n(.*?)```", guide, re.DOTALL))
    (tmp_path / "mine/stopped_car.py").write_text(blocks["stopped_car.py"])
    files = [str(tmp_path / f"mine/{name}.py") for name in ("stopped_car", "toy_copula", "toy_check")]
    environment = os.environ | {VARIABLE: os.pathsep.join(files)}
    generator = np.random.default_rng(1)
    records = pd.DataFrame({"speed_mps": generator.normal(9, 2, 400), "gap_m": generator.normal(35, 8, 400)})
    records.clip([1, 1], [19, 99], axis=1).assign(driver=np.arange(400) % 40).to_csv(tmp_path / "records.csv")
    settings = {
        "study": "toy",
        "scenario": {"name": "stopped_car", "records": "records.csv"},
        "modules": files,
    }
    (tmp_path / "toy.yaml").write_text(json.dumps(settings))
    here = ["--scenario", "stopped_car"]
    law = [*here, "--law", "results/toy/estimate/law.json"]
    printed = run(
        tmp_path,
        environment,
        ["simulate", "records.csv", "out.csv", *here],
        ["estimate", "--config", "toy.yaml", "--law", "toy_copula"],
        ["inspect", "toy.yaml"],
        ["replay", "9", "35", "trace.csv", *here, "--figure", "trace.svg"],
        ["campaign", "new", "c.json", *law],
        ["campaign", "ask", "c.json", "next"],
        ["simulate", "next/runs.csv", "done.csv", *here],
        ["campaign", "tell", "c.json", "done.csv"],
        ["export", "set", *law],
    )
    out = pd.read_csv(tmp_path / "out.csv")
    assert out["gap_left"].to_numpy() == pytest.approx(
        out["gap_m"] - out["speed_mps"] - out["speed_mps"] ** 2 / 12
    )
    assert "FINE  equal values" in printed
    assert f"{(out['speed_mps'] > 15).sum()} of them" in printed
    assert json.loads((tmp_path / "results/toy/estimate/law.json").read_text())["kind"] != "gaussian_copula"
    trace, far = pd.read_csv(tmp_path / "trace.csv"), 35 - 9 - 9**2 / 12
    assert trace["gap_m"].iloc[-1] == pytest.approx(far, abs=0.1)
    assert "10 new or corrected" in printed
    weights = pd.read_csv(tmp_path / "set/scenarios.csv")
    assert weights["weight"].sum() == pytest.approx(1)
    found = pd.read_csv(tmp_path / "results/toy/estimate/estimate.csv").iloc[0]
    # The gap is normal, so that the probability of a crash is a mean over speeds.
    speed = norm.ppf((np.arange(10_000) + 0.5) / 10_000, 9, 2)
    truth = np.mean(norm.cdf(speed + speed**2 / 12, 35, 8))
    assert found["converged"]
    assert 0.4 * truth < found["probability"] < 2.5 * truth  # 400 records leave this much open
