"""Whole small studies of odd data, vehicles and settings: each ends with every figure, table and chapter.

They take minutes, so `make test-studies` runs them, and `make test` does not. Those that differ most are not
marked `rest`, and `.ci/run` runs them, too.
"""

import re
import shutil
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import yaml
from accelerated_evaluation.records.checks import CHECKS

HERE = Path(__file__).parent
TINY = {
    "study": "tiny",
    # Whether the records can be trusted is not the question here.
    "data": {
        "sample": 1500,
        "spmd": {"outlier_rows": []},
        "accepted_warnings": [name.replace("_", " ") for name in CHECKS],
    },
    "models": {
        "inverse_range": {
            "two_pieces": {"profile": {"points": 8}},
            "three_pieces": {"profile": {"points": 8}},
        }
    },
    "cross_entropy": {
        "seeds": 2,
        "sample_size": 300,
        "minimum_events": 20,
        "maximum_batches": 10,
        "maximum_iterations": 20,
    },
    "importance_sampling": {
        "replicates": 2,
        "minimum_events": 20,
        "simulations": 1000,
        "maximum_simulations": 2000,
        "course_step": 20,
    },
    "crash_map": {
        "grid": {"lead_speed_cells": 8, "range_cells": 12, "refinement": 2, "closing_speed_points": 60},
        "events": {"impact_speed": [0, 5], "min_range": [1], "min_ttc": [1]},
    },
    "answer": {
        "grid": {"lead_speed_cells": 8, "range_cells": 12, "refinement": 2, "closing_speed_points": 60},
        "draws": 50,
    },
    "sensitivity": {
        "inverse_ttc_knots": [0.9, 0.99],
        "inverse_range_knots": [0.8],
        "lead_speed_edges": [[5, 35]],
        "closing_speed_max": [20],
    },
    "uncertainty": {"replicates": 10},
    "crude_monte_carlo": {"simulations": 20000, "batch_size": 10000},
    "surrogate": {"replicates": 2, "maximum_calls": 100},
    "coverage": {"replicates": 2, "pilot": 500},
}
FAST = {"filters": {"lead_speed_min": 25}, "segments": {"lead_speed_edges": [25, 35]}}
FAST |= {"sensitivity": {"lead_speed_edges": [[25, 30, 35]]}}


def merged(base, change):
    """Return a configuration with another over it, section by section."""
    sections = [key for key, value in change.items() if isinstance(value, dict)]
    below = {key: merged(base.get(key) or {}, change[key]) for key in sections}
    return base | change | below


def car(name, **parameters):
    """Name a vehicle of `odd_vehicles.py` in the configuration."""
    return {"vehicle": {"name": f"odd_vehicles.py:{name}", "parameters": parameters}}


def table(name, **config):
    """Take the records of a table of `TABLES`."""
    return merged(config, {"data": {"source": "table", "sample": None, "table": {"path": f"{name}.csv"}}})


def cut_ins(rows, lead_speeds=(5, 35)):
    """Draw plausible lane changes, as a user might bring them."""
    generator = np.random.default_rng(1)
    range_ = 1 / np.minimum(1 / 75 + generator.exponential(0.015, rows), 1.2)
    columns = {
        "lead_speed": generator.uniform(*lead_speeds, rows),
        "range": range_,
        "closing_speed": np.minimum(generator.exponential(0.045, rows) * range_, 20),
    }
    return pd.DataFrame(columns)


def rounded():
    """Round lane changes so coarsely that all values lie on edges of bins and cells."""
    return (
        cut_ins(900).round({"lead_speed": -1, "range": -1, "closing_speed": 0}).clip([10, 10, 1], [30, 70, 6])
    )


OTHER_UNITS = {
    "lead_speed": {"name": "v [mph]", "unit": "mph"},
    "range": {"name": "1/gap", "unit": "1/ft"},
    "closing": {"name": "ttc", "quantity": "ttc", "unit": "ms"},
}


def other_units():
    """Draw motorway cut-ins in the units of another recorder, with rows that cannot be used and repeats."""
    cut_in = cut_ins(900, (20, 45))
    columns = {
        "v [mph]": cut_in["lead_speed"] / 0.44704,
        "1/gap": 0.3048 / cut_in["range"],
        "ttc": 1000 * cut_in["range"] / cut_in["closing_speed"],
    }
    rows = pd.DataFrame(columns)
    rows.loc[[5, 70], "ttc"] = np.inf
    return rows.loc[rows.index.repeat(1 + (rows.index % 50 == 0))]


def short_and_heavy():
    """Draw cut-ins at short ranges alone, whose TTC^-1 has hardly a mean."""
    generator, cut_in = np.random.default_rng(2), cut_ins(900)
    range_ = generator.uniform(2, 8, 900)
    return cut_in.assign(
        range=range_, closing_speed=np.minimum(0.05 * generator.pareto(1.1, 900) * range_, 40)
    )


TABLES = {
    "one-speed": lambda: cut_ins(600).assign(lead_speed=20.0),
    "least": lambda: cut_ins(30, (20, 29)),  # rows that a segment has to have
    "rounded": rounded,
    "other-units": other_units,
    "short-and-heavy": short_and_heavy,
}


AUTOMATIC = {"sensitivity": {"lead_speed_edges": "auto", "closing_speed_max": "auto"}}


def described(text):
    """Describe the data in the words of a user."""
    return {"data": {"spmd": {"description": text}}}


SMALLEST = {  # every number as small as the schema allows
    "seed": 4294967295,
    "cross_entropy": {
        "seeds": 1,
        "sample_size": 10,
        "minimum_events": 1,
        "maximum_batches": 1,
        "maximum_iterations": 1,
    },
    "importance_sampling": {
        "replicates": 1,
        "minimum_events": 1,
        "simulations": 100,
        "maximum_simulations": 100,
        "course_step": 1,
    },
    "crude_monte_carlo": {"simulations": 100, "batch_size": 100},
    "surrogate": {"replicates": 1, "batch_size": 1},
    "coverage": {"replicates": 2, "pilot": 100},
    "crash_map": {
        "grid": {"lead_speed_cells": 4, "range_cells": 4, "refinement": 1, "closing_speed_points": 10}
    },
    "answer": {
        "grid": {"lead_speed_cells": 4, "range_cells": 4, "refinement": 1, "closing_speed_points": 10},
        "draws": 20,
    },
}
STUDIES = {
    "never crashes": car("Never"),
    "crashes always": car("From"),
    "crashes in a tenth of the cut-ins": car("From", inverse_ttc=0.1),
    "crashes in the slowest segment alone": car("From", inverse_ttc=0.4, slower_than=15.0)
    | described("<script>alert(1)</script><b>bold & brave</b> </td></tr> costs $5"),
    "crashes below the knot": car("From", inverse_ttc=0.03),
    "hardly ever crashes": car("From", inverse_ttc=2.5),
    "fast cut-ins alone": FAST,
    "500 records": {"data": {"sample": 500}},
    "200 records": {"data": {"sample": 200}},
    "one segment": {"segments": {"lead_speed_edges": [5, 35]}},
    "many segments": {"segments": {"lead_speed_edges": [5, 10, 15, 20, 25, 30, 35]}},
    "a description with dollars and bars": described("costs $5 | 'quoted' and \"quoted\" _x_ *y*"),
    "a description with braces": described("{{ x }} {x} {{ 1 / 0 }} {% if %} {0!r} {"),
    "alpha near one": {"importance_sampling": {"alpha": 0.999}},
    "alpha near zero": {"importance_sampling": {"alpha": 1e-6}},
    "one threshold of the impact speed": {"crash_map": {"events": {"impact_speed": [3]}}},
    "three pieces": {"models": {"inverse_range": {"variant": "three_pieces"}}},
    "speed segments far from the default": {
        "filters": {"lead_speed_min": 0, "lead_speed_max": 60},
        "segments": {"lead_speed_edges": [0, 12.5, 60]},
        "sensitivity": {"lead_speed_edges": [[0, 60], [0, 20, 60]]},
    },
    "one lead speed": table("one-speed", **AUTOMATIC),
    "the fewest records": table("least", **AUTOMATIC),
    "rounded records": table("rounded"),
    "NaN": SMALLEST,  # a name that a table could take for a missing value
    "motorway in other units": table(
        "other-units",
        data={"invalid_rows": "drop", "repeated_rows": "drop", "table": {"columns": OTHER_UNITS}},
        filters={"lead_speed_min": 20, "lead_speed_max": 45},
        segments={"lead_speed_edges": [20, 30, 45]},
        crash_map={"events": {"impact_speed": [5, 0, 5], "min_range": [2, 1], "min_ttc": [1.5, 0.5]}},
        **AUTOMATIC,
    ),
    "short ranges and a heavy tail": table("short-and-heavy", **AUTOMATIC),
    "a reference driver beside itself": {
        "vehicle": {"name": "fsm"},
        "compared_vehicles": {"tailgater": {"name": "acc_aeb", "parameters": {"headway": 0.5, "aeb": False}}},
        "models": {"closing_speed_max": 1},
        "crash_map": {"grid": {"closing_speed_max": 1}},
    },
}


pytestmark = [pytest.mark.studies, pytest.mark.rest]  # each takes more than two minutes of processor time


@pytest.fixture(scope="module")
def shared(tmp_path_factory, project_in):
    """Return one folder for all studies, which share the crash maps of the vehicles that are compared."""
    project = project_in(tmp_path_factory.mktemp("studies"))
    shutil.copy(HERE / "odd_vehicles.py", project.folder)
    for name, made in TABLES.items():
        made().to_csv(project.folder / f"{name}.csv", index=False)
    return project


@pytest.mark.parametrize("name", STUDIES)
def test_the_study_ends_whole(shared, name):
    study = re.sub(r"\W", "-", name)
    config = merged(TINY, STUDIES[name]) | {"study": study}
    (shared.folder / f"{study}.yaml").write_text(yaml.safe_dump(config, allow_unicode=True))
    run = shared.run(config=f"{study}.yaml", cores=1)
    output = run.stdout + run.stderr
    assert run.returncode == 0, output[-8000:]
    assert "Traceback" not in output
    results, figures = (shared.folder / part / study for part in ("results", "figures"))
    for notebook in (shared.folder / "notebooks").glob("*.ipynb"):
        page = (results / "book" / f"{notebook.stem}.html").read_text()
        assert "<script>alert(1)" not in page
        words = re.sub(r"<(script|style).*?</\1>|<[^>]+>", " ", page, flags=re.DOTALL)
        assert not re.search(r"\bnan\b", words), notebook
    assert len(list(figures.glob("fig*.svg"))) == len(list(figures.glob("fig*.csv"))) >= 20
    estimates = pd.read_csv(results / "estimates.csv")
    published = pd.read_csv(figures / "tables" / "estimates.csv", keep_default_na=False)
    assert set(published["study"]) == {study}
    known = estimates.dropna(subset="probability")
    assert (known["ci_low"] <= known["ci_high"]).all()
    assert estimates[["ci_low", "ci_high"]].notna().all(axis=None)
