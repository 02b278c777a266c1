"""What runs again after an edit: all that depends on what was edited, and nothing else."""

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

# By hand: the rules that stand first in line to run again after some modules are edited, with those modules,
# and all rules that run then. Together the modules are of every room. For a rule that waits for another,
# Snakemake gives no reason of its own: leaves of the import graph are edited together, its trunk by itself.
FIT = {"ingest_encounters", "describe_encounters", "fit_models", "fit_candidates", "collect_candidates"}
SEARCH = {"search_proposals", "collect_traces"}
ESTIMATE = {"estimate_single", "estimate_piecewise", "estimate_heuristic", "estimate_surrogate"}
ESTIMATE |= {"estimate_shifted", "estimate_toy_method"}
JUDGE = {"run_crude_monte_carlo", "study_coverage", "collect_coverage"}
TRUTH = {"compute_exact", "repeat_searches", "bootstrap_uncertainty", "study_sensitivity"}
LAWS = {"fit_family", "study_laws", "compare_laws", "compare_record_variants", "replay_encounters"}
LAWS |= {"count_crashes", "predict_humans", "study_lead_motion", "explorer"}
END = {"accept_records", "book", "all"}
DRIVEN = {"map_crashes_uncapped"}
STUDY = SEARCH | ESTIMATE | JUDGE | TRUTH | {"collect_estimates", *END}
EDITS = {
    "leaves": (
        {
            "fit_candidates": {"laws/paper/candidate_families.py", "laws/paper/comparison.py"},
            "bootstrap_uncertainty": {"crash_map/uncertainty.py"},
            "run_13_what_happened": {"publishing/figures/preventable.py"},
        },
        {"fit_candidates", "collect_candidates", "bootstrap_uncertainty", *END},
    ),
    "methods": (
        {
            "estimate_surrogate": {"../fewruns/gaussian_process.py"},
            "run_crude_monte_carlo": {"methods/crude.py"},
            "study_coverage": {"methods/crude.py"},
        },
        {"estimate_surrogate", "collect_estimates", *JUDGE, *END},
    ),
    "vehicle": (
        {
            **{key: {"vehicles/builtin/kernel.py"} for key in {"map_crashes", *DRIVEN}},
            "inspect_records": {"vehicles/builtin/kernel.py"},
            "fit_family": {
                "vehicles/builtin/kernel.py"
            },  # its modules name vehicles, though none is simulated
            "search_proposals": {"vehicles/builtin/kernel.py"},
            "run_crude_monte_carlo": {"vehicles/builtin/kernel.py"},
            "estimate_surrogate": {"vehicles/builtin/kernel.py"},
            "estimate_toy_method": {"vehicles/builtin/kernel.py"},
        },
        STUDY | LAWS | DRIVEN | {"map_crashes", "inspect_records"},
    ),
    "records": (
        {rule: {"records/filters.py"} for rule in ("inspect_records", "ingest_encounters")},
        FIT | STUDY | LAWS | {"inspect_records"},
    ),
}


def edited_inputs(output: str) -> dict[str, set[str]]:
    """Return the edited modules because of which a rule would run, by rule, as a dry run tells them."""
    concerned: dict[str, set[str]] = {}
    for rule, files in re.findall(
        r"^(\w+): .*\n    because of (?:.*; )?edited ([^;\n]*)", output, re.MULTILINE
    ):
        for path in files.split(", "):
            concerned.setdefault(rule, set()).add(os.path.relpath(path, LIBRARY))
    return concerned


@pytest.fixture(scope="module")
def studied(finished, tmp_path_factory):
    """Return a copy of the finished project, whose files these tests edit."""
    return finished.copied(tmp_path_factory.mktemp("studied"))


@pytest.mark.parametrize("edit", EDITS)
def test_an_edited_module_reruns_what_imports_it_and_no_more(studied, edit):
    first, planned = EDITS[edit]
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
    # Notebooks look up methods and laws for their looks, so nearly all of them depend on each of these.
    rules = {
        rule: files for rule, files in edited_inputs(output).items() if rule in first or not of_notebook(rule)
    }
    assert rules == first
    assert {rule for rule in planned_rules(output) if not of_notebook(rule)} == planned


def of_notebook(rule: str) -> bool:
    """Tell whether a rule runs a notebook, which are called run_01_... and so on."""
    return re.match(r"run_\d\d_", rule) is not None


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
            paths.append(f"{Path(name).stem}_again.yaml")
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
    assert "map_crashes" not in smoke(study="other")
    assert "map_crashes" in smoke(study="other", vehicle={"parameters": {"aeb": False}})


def test_an_edited_setting_reruns_the_rules_that_name_it(smoke):
    planned = smoke(coverage={"replicates": 11, "pilot": 2000})
    assert planned & {"study_coverage", "collect_coverage"} == {"study_coverage", "collect_coverage"}
    assert not planned & {"ingest_encounters", "fit_models", "search_proposals", "estimate_piecewise"}


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
        assert len(code.splitlines()) <= 40, path
        assert set(re.findall(r"snakemake\.(\w+)", code)) <= allowed, path
