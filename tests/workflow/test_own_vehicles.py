"""A study that compares users' own vehicles, classes and a command: the example of docs/your_vehicle.md."""

import re
import shutil
from pathlib import Path

import pandas as pd
import pytest
import yaml
from accelerated_evaluation.study.configuration import ConfigurationError, load

ROOT = Path(__file__).resolve().parents[2]
GUIDE = (ROOT / "docs" / "your_vehicle.md").read_text(encoding="utf-8")
FILES = dict(re.findall(r"^File `([^`]+)`:\n\n```\w+\n(.*?)^```$", GUIDE, re.DOTALL | re.MULTILINE))
CONFIG = "my_comparison.yaml"
TABLE = "results/smoke/laws/vehicles.csv"


def compare(project):
    """Give a project the files of the guide, and its comparison for the study that is finished."""
    if shutil.which("awk") is None:
        pytest.skip("no awk is here")
    for name, content in FILES.items():
        (project.folder / name).write_text(content)
    comparison = yaml.safe_load(FILES[CONFIG]) | {"study": "smoke"}
    del comparison["answer"]  # the grid of the finished study is coarser, and its maps are there already
    (project.folder / CONFIG).write_text(yaml.safe_dump(comparison))
    project.configs = (*project.configs, CONFIG)
    return project


def rules_to_run(project, *targets):
    """Return the rules that a dry run would run."""
    run = project.run("--dry-run", *targets)
    assert run.returncode == 0, run.stderr[-5000:]
    return set(re.findall(r"^(\w+): .*\n    because of", run.stdout + run.stderr, re.MULTILINE))


@pytest.mark.studies
def test_own_vehicles_are_compared(finished, tmp_path):
    """The finished study gets other vehicles, so that only what concerns vehicles runs."""
    clone = compare(finished.copied(tmp_path))
    run = clone.run(TABLE)
    assert run.returncode == 0, run.stderr[-5000:]
    table = pd.read_csv(clone.folder / TABLE).set_index("vehicle")
    assert {"under test", "brakes_harder", "in_awk", "weak_aeb", "cc_human"} < set(table.index)
    same, other = table.loc["under test"], table.loc["in_awk"]  # the same car in two languages
    assert other["recorded"] == same["recorded"]
    # The lines of a map are thinned at random for each vehicle.
    assert other["probability"] == pytest.approx(same["probability"], rel=0.05)
    assert 0 < table.loc["brakes_harder", "probability"] < 0.9 * same["probability"]
    assert len(list(clone.folder.glob("results/vehicles/*/outcomes.sqlite"))) == 1  # of the command

    assert not rules_to_run(clone, TABLE)
    program = clone.folder / "my_vehicle.awk"
    program.write_text(program.read_text().replace("reaction = 0.75", "reaction = 0.5"))
    assert rules_to_run(clone, TABLE) == {"map_crashes_uncapped", "compare_vehicles"}


def test_the_vehicles_of_a_comparison_are_looked_up_before_any_job(project):
    clone = compare(project)
    (clone.folder / "my_vehicle.awk").unlink()
    config = yaml.safe_load((clone.folder / CONFIG).read_text())
    config["compared_vehicles"]["brakes_harder"]["name"] = "my_vehicle.py:Breaking"
    (clone.folder / CONFIG).write_text(yaml.safe_dump(config))
    run = clone.run(TABLE)
    assert run.returncode != 0
    assert "compared_vehicles.brakes_harder, vehicle my_vehicle.py:Breaking: seen no class" in run.stderr
    assert "Did you mean Braking?" in run.stderr
    assert not (clone.folder / "results").exists()


@pytest.mark.parametrize(
    ("entry", "reported"),
    [
        ({"cc_human": {"name": "my_vehicle.py:Braking"}}, "the name of a built-in vehicle only where"),
        ({"under_test": {"name": "rss"}}, "labels that are not under_test"),
        ({"again": {"name": "rss"}}, "vehicles that differ from each other"),
        ({"my car": {"name": "rss"}}, 'seen "my car"; expected text matching'),
        ({"rss": {"reaction_time": 0.5}}, "compared_vehicles.rss.reaction_time: seen an unknown key"),
    ],
)
def test_entries_that_mislead_are_refused(entry, reported):
    with pytest.raises(ConfigurationError, match=re.escape(reported)):
        load(given={"compared_vehicles": entry})
