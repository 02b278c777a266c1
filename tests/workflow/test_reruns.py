"""What runs again after an edit: everything that depends on what was edited."""

import os
import re
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import yaml

ROOT = Path(__file__).resolve().parents[2]
LIBRARY = Path("workflow/accelerated_evaluation")
EDIT = "\n# edited\n"

# By hand: the rules that run again after an edit, besides those of the notebooks and those that always do.
ALWAYS = {"explorer", "name_numbers", "book", "all", "accept_records", "draw_toy_figure"}
ANSWER = {"fit_family", "study_answer", "compare_vehicles", "compare_laws", "compare_record_variants"}
ANSWER |= {"replay_encounters", "count_crashes", "predict_humans", "study_lead_motion", "judge_criteria"}
ANSWER |= {"compute_twice"}
SEARCHING = ("single", "piecewise", "heuristic", "shifted")
METHODS = {"search_proposals", "collect_traces", "compute_exact", "run_crude_monte_carlo", "study_coverage"}
METHODS |= {f"estimate_{name}" for name in (*SEARCHING, "surrogate", "toy_method")}
METHODS |= {"collect_estimates", "collect_coverage", "repeat_searches"}


@pytest.fixture(scope="module")
def studied(finished, tmp_path_factory):
    """Return a copy of the finished project, whose files these tests edit."""
    return finished.copied(tmp_path_factory.mktemp("studied"))


def planned_after_an_edit(studied, path):
    """Return the rules that would run after a line is added to a file of the study."""
    file = studied.folder / path
    text, status = file.read_text(), file.stat()
    try:
        file.write_text(text + EDIT)
        run = studied.run("--dry-run")
    finally:
        file.write_text(text)
        os.utime(file, ns=(status.st_atime_ns, status.st_mtime_ns))
    return planned_rules(run.stdout + run.stderr)


def test_an_edited_module_reruns_its_room_and_those_after_it(studied):
    planned = planned_after_an_edit(studied, LIBRARY / "methods/crude.py")
    notebooks = {rule for rule in planned if re.match(r"run_\d\d_", rule)}
    assert len(notebooks) == len(list((studied.folder / "notebooks").glob("*.ipynb")))
    assert planned - notebooks == METHODS | ANSWER | ALWAYS


OF_DISTRIBUTIONS = {"fit_models", "fit_candidates", "study_sensitivity", "bootstrap_uncertainty"}


@pytest.mark.parametrize(
    ("name", "rules"),
    {
        "exponential": METHODS | OF_DISTRIBUTIONS | ANSWER - {"fit_family"} | ALWAYS,
        "method": {"estimate_toy_method", "collect_estimates"} | ALWAYS - {"explorer", "draw_toy_figure"},
        "figure": ALWAYS - {"explorer"},
    }.items(),
)
def test_an_edited_extension_reruns_what_uses_it(studied, name, rules):
    """Records and maps use no distribution, the other estimates no method, and notebooks no figure."""
    planned = planned_after_an_edit(studied, f"mine/toy_{name}.py")
    notebooks = {rule for rule in planned if re.match(r"run_\d\d_", rule)}
    assert planned - notebooks == rules
    assert bool(notebooks) == (name != "figure")


def backwards(section):
    """Return a section of a configuration, and those in it, with its keys in the opposite order."""
    if not isinstance(section, dict):
        return section
    return {key: backwards(value) for key, value in reversed(section.items())}


@pytest.fixture
def smoke(studied):
    """Return a function that tells which rules would run after changes of the configuration."""

    def plan(*, reverse: bool = False, **changes) -> set[str]:
        paths = []
        for name in studied.configs:
            config = yaml.safe_load((studied.folder / name).read_text())
            if reverse:
                config = {key: backwards(section) for key, section in reversed(config.items())}
            paths.append(str(Path(name).with_name(f"{Path(name).stem}_again.yaml")))  # modules are relative
            (studied.folder / paths[-1]).write_text(yaml.safe_dump(config, sort_keys=False))
        (studied.folder / "changes.yaml").write_text(yaml.safe_dump(changes))
        run = studied.run("--dry-run", config=" ".join([*paths, "changes.yaml"]))
        assert run.returncode == 0, run.stderr
        return planned_rules(run.stdout + run.stderr)

    return plan


def planned_rules(output: str) -> set[str]:
    """Return the rules that a dry run would run."""
    statistics = output.split("Job stats:")[-1].split("\n\n")[0]
    return set(re.findall(r"^(\w+) +\d+$", statistics, flags=re.MULTILINE)) - {"total"}


def test_the_order_of_keys_and_sections_that_are_not_used_rerun_nothing(smoke):
    unused = {"path": "mine.csv", "description": "not used"}
    assert smoke(reverse=True, data={"sample": 6000, "spmd": {"outlier_rows": []}, "table": unused}) == set()


def test_studies_of_one_vehicle_share_its_crash_map(smoke):
    planned = smoke(study="other")
    assert "map_crashes" not in planned
    assert {"ingest_encounters", "fit_models"} <= planned


def test_an_edited_setting_reruns_the_rules_that_name_it(smoke):
    planned = smoke(coverage={"replicates": 11, "pilot": 2000}, vehicle={"parameters": {"aeb": False}})
    assert {"map_crashes", "search_proposals"} <= planned
    assert planned & {"study_coverage", "collect_coverage"} == {"study_coverage", "collect_coverage"}
    assert not planned & {"ingest_encounters", "fit_models"}


def test_a_table_counts_by_its_content_and_not_by_its_date(project):
    table = project.folder / "mine.csv"
    rows = pd.DataFrame({"lead_speed": [10.0, 20.0, 30.0] * 60, "range": np.linspace(20, 60, 180)})
    rows["closing_speed"] = np.linspace(1, 5, 180)
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


def test_scripts_are_short_and_read_what_their_rule_names():
    allowed = {"input", "output", "params", "wildcards", "log", "threads"}
    scripts = list((ROOT / "workflow/scripts").glob("*.py"))
    assert len(scripts) > 15
    for path in scripts:
        code = path.read_text()
        assert len(code.splitlines()) <= 42, path
        assert set(re.findall(r"snakemake\.(\w+)", code)) <= allowed, path
