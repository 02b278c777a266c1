"""What runs again after an edit: all that depends on what was edited, and nothing else."""

import os
import re
from pathlib import Path

import pandas as pd
import pytest
import yaml

ROOT = Path(__file__).resolve().parents[2]
LIBRARY = Path("workflow/accelerated_evaluation")
EDIT = "\n# edited\n"

# By hand: the rules that stand first in line to run again after some modules are edited, with those modules,
# and all rules that run then. Together the modules are of every room. For a rule that waits for another,
# Snakemake gives no reason of its own: leaves of the import graph are edited together, its trunk by itself.
LEAVES = (
    {
        "fit_candidates": {"fitting/candidate_families.py", "laws/comparison.py"},
        "sample_by_surrogate": {"methods/surrogate/gaussian_process.py"},
        "run_crude_monte_carlo": {"methods/crude.py"},
        "bootstrap_uncertainty": {"truth/uncertainty_study.py"},
        "run_07_conclusions": {"publishing/claims.py"},
    },
    {
        *("fit_candidates", "collect_candidates", "sample_by_surrogate", "run_crude_monte_carlo"),
        *("bootstrap_uncertainty", "run_02_single_parametric_models", "run_03_piecewise_mixture_models"),
        *("run_07_conclusions", "run_08_ground_truth", "run_10_fewest_simulations", "all"),
    },
)
SEARCH = {"search_proposals", "collect_traces"}
JUDGE = {"compute_exact", "bootstrap_uncertainty", "study_sensitivity", "study_coverage"}
ESTIMATE = {"estimate_crash_probability", "collect_estimates", "collect_coverage"}
SAMPLE = {"run_crude_monte_carlo", "sample_by_surrogate", "all"}
FIT = {"ingest_encounters", "describe_encounters", "fit_models", "fit_candidates", "collect_candidates"}
VEHICLE = (
    {
        rule: {"vehicles/kernel.py"}
        for rule in ("map_crashes", "search_proposals", "run_crude_monte_carlo", "sample_by_surrogate")
    },
    SEARCH | JUDGE | ESTIMATE | SAMPLE | {"map_crashes"},
)
RECORDS = ({"ingest_encounters": {"encounters/filters.py"}}, FIT | SEARCH | JUDGE | ESTIMATE | SAMPLE)


def edited_inputs(output: str) -> dict[str, set[str]]:
    """Return the edited modules because of which a rule would run, by rule, as a dry run tells them."""
    concerned: dict[str, set[str]] = {}
    for rule, files in re.findall(
        r"^(\w+): .*\n    because of (?:.*; )?edited ([^;\n]*)", output, re.MULTILINE
    ):
        for path in files.split(", "):
            concerned.setdefault(rule, set()).add(str(Path(path).relative_to(LIBRARY)))
    return concerned


@pytest.fixture(scope="module")
def studied(finished, tmp_path_factory):
    """Return a copy of the finished project, whose files these tests edit."""
    return finished.copied(tmp_path_factory.mktemp("studied"))


@pytest.mark.parametrize(
    ("first", "planned"), [LEAVES, VEHICLE, RECORDS], ids=["leaves", "vehicle", "records"]
)
def test_an_edited_module_reruns_what_imports_it_and_no_more(studied, first, planned):
    modules = [studied.folder / LIBRARY / module for module in set().union(*first.values())]
    before = [(path.read_text(), path.stat()) for path in modules]
    try:
        for path in modules:
            path.write_text(path.read_text() + EDIT)
        run = studied.run("--dry-run")
    finally:
        for path, (text, status) in zip(modules, before, strict=True):
            path.write_text(text)
            os.utime(path, ns=(status.st_atime_ns, status.st_mtime_ns))
    output = run.stdout + run.stderr
    of_notebooks = {rule for rule in planned_rules(output) if rule.startswith("run_") and rule[4].isdigit()}
    # The trunk of the graph concerns nearly all notebooks, whose figures decide.
    ignored = of_notebooks if first is not LEAVES[0] else set()
    assert {rule: files for rule, files in edited_inputs(output).items() if rule not in ignored} == first
    assert planned_rules(output) - ignored == planned


@pytest.fixture
def smoke(studied):
    """Return a function that tells which rules would run after changes of the configuration."""

    def plan(*, reverse: bool = False, **changes) -> set[str]:
        config = yaml.safe_load((studied.folder / "config" / "smoke.yaml").read_text()) | changes
        if reverse:
            config = dict(reversed(config.items()))
            config["crash_map"] = {
                key: dict(reversed(config["crash_map"][key].items())) for key in ("events", "grid")
            }
        path = studied.folder / "changed.yaml"
        path.write_text(yaml.safe_dump(config, sort_keys=False))
        run = studied.run("--dry-run", config="changed.yaml")
        assert run.returncode == 0, run.stderr
        return planned_rules(run.stdout + run.stderr)

    return plan


def planned_rules(output: str) -> set[str]:
    """Return the rules that a dry run would run."""
    statistics = output.split("Job stats:")[-1].split("\n\n")[0]
    return set(re.findall(r"^(\w+) +\d+$", statistics, flags=re.MULTILINE)) - {"total"}


def test_the_order_of_keys_and_sections_that_are_not_used_rerun_nothing(smoke):
    data = {"table": {"path": "mine.csv", "description": "not used"}}
    assert smoke(reverse=True, data={"twin": {"events": 6000}} | data) == set()


def test_studies_of_one_vehicle_share_its_crash_map(smoke):
    assert "map_crashes" not in smoke(study="other")
    assert "map_crashes" in smoke(study="other", vehicle={"parameters": {"aeb": False}})


def test_an_edited_setting_reruns_the_rules_that_name_it(smoke):
    planned = smoke(coverage={"replicates": 11, "pilot": 2000})
    assert planned & {"study_coverage", "collect_coverage"} == {"study_coverage", "collect_coverage"}
    assert not planned & {"ingest_encounters", "fit_models", "search_proposals", "estimate_crash_probability"}


def test_a_table_counts_by_its_content_and_not_by_its_date(project):
    table = project.folder / "mine.csv"
    rows = pd.DataFrame({"lead_speed": [10.0, 20.0, 30.0] * 20, "range": 20.0, "closing_speed": 1.0})
    rows.to_csv(table, index=False)
    config = {"study": "mine", "data": {"source": "table", "table": {"path": "mine.csv"}}}
    (project.folder / "mine.yaml").write_text(yaml.safe_dump(config))
    target = "results/mine/encounters.parquet"

    def is_planned() -> bool:
        run = project.run("--dry-run", target, config="mine.yaml")
        assert run.returncode == 0, run.stderr
        return "ingest_encounters" in planned_rules(run.stdout + run.stderr)

    assert project.run(target, config="mine.yaml").returncode == 0
    table.touch()
    assert not is_planned()
    rows.assign(range=21.0).to_csv(table, index=False)
    os.utime(table, (0, 0))
    assert is_planned()


@pytest.mark.parametrize("path", sorted((ROOT / "workflow/scripts").glob("*.py")), ids=lambda path: path.stem)
def test_scripts_are_short_and_read_what_their_rule_names(path):
    code = path.read_text()
    assert len(code.splitlines()) <= 40
    assert set(re.findall(r"snakemake\.(\w+)", code)) <= {"input", "output", "params", "wildcards", "log"}
