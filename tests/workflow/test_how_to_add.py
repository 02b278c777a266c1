"""CONTRIBUTING.md, "How to add ...": a toy method, distribution and vehicle, each by its own files alone.

One copy of the project gets all three, and runs the whole smoke study with them.
"""

import json

import pandas as pd
import pytest
import yaml

LIBRARY = "workflow/accelerated_evaluation"
METHOD = '''"""A toy: crude Monte Carlo with a thousand simulations."""

from typing import ClassVar

import numpy as np

from accelerated_evaluation.methods import METHODS, Estimate, Method
from accelerated_evaluation.methods.intervals import binomial_interval


@METHODS.add("toy_method")
class ToyMethod(Method):
    """A thousand draws from the law itself."""

    name: ClassVar[str] = "toy_method"
    look: ClassVar[dict] = {"color": "black", "linestyle": "-", "marker": "P"}

    def estimate(self, problem, stopping, generator):
        """Estimate the probability of the event by its share."""
        happened, _ = problem.evaluate(generator.standard_normal((1000, problem.dimension)))
        events = int(np.count_nonzero(happened))
        low, high = binomial_interval(events, 1000, stopping.alpha)
        return Estimate(events / 1000, low, high, stopping.alpha, 0, 1000, events, converged=False)
'''
DISTRIBUTION = '''"""A toy: a bounded exponential by another name."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

from accelerated_evaluation.distributions.bounded_exponential import BoundedExponential
from accelerated_evaluation.distributions.described import Parameter, distribution


@distribution("toy exponential")
@dataclass(frozen=True)
class ToyExponential(BoundedExponential):
    """As its parent."""

    parameters: ClassVar[Mapping[str, Parameter]] = {"rate": Parameter(power=-1, symbol="q")}
'''
VEHICLE = '''"""A toy: a car that brakes at once, with a constant deceleration."""

from dataclasses import dataclass

import numpy as np

from accelerated_evaluation.vehicles.registry import VEHICLES
from accelerated_evaluation.vehicles.protocol import Outcomes


@VEHICLES.add("toy_car")
@dataclass(frozen=True)
class ToyCar:
    """It stops closing in after closing_speed^2 / (2 deceleration) metres."""

    deceleration: float = 3.0

    def simulate(self, lead_speed, range_, closing_speed):
        """Simulate n cut-ins."""
        left = range_ - np.square(np.maximum(closing_speed, 0)) / (2 * self.deceleration)
        crash = left <= 0
        at_impact = np.sqrt(np.maximum(np.square(closing_speed) - 2 * self.deceleration * range_, 0))
        ttc = np.where(closing_speed > 0, range_ / np.maximum(closing_speed, 1e-300), np.inf)
        return Outcomes(crash, np.minimum(left, range_), ttc, np.where(crash, at_impact, 0.0))
'''
FILES = {
    f"{LIBRARY}/methods/toy_method.py": METHOD,
    f"{LIBRARY}/distributions/toy_exponential.py": DISTRIBUTION,
    f"{LIBRARY}/vehicles/toy_car.py": VEHICLE,
}


@pytest.fixture(scope="module")
def extended(tmp_path_factory, project_in):
    """Return a project with the three toys, whose smoke study was run with them."""
    project = project_in(tmp_path_factory.mktemp("extended"))
    for path, content in FILES.items():
        (project.folder / path).write_text(content)
    settings = yaml.safe_load((project.folder / "config/smoke.yaml").read_text())
    settings |= {
        "methods": ["single", "piecewise", "heuristic", "surrogate", "toy_method", "crude"],
        "vehicle": {"name": "toy_car"},
    }
    settings["models"]["inverse_ttc"] = {"tail": "toy exponential"}
    (project.folder / "toys.yaml").write_text(yaml.safe_dump(settings))
    run = project.run(config="toys.yaml", quick=True)
    assert run.returncode == 0, (run.stdout + run.stderr)[-5000:]
    return project


def test_a_new_method_is_estimated_with_and_compared(extended):
    estimates = pd.read_csv(extended.folder / "results/smoke/estimates.csv")
    assert set(estimates.loc[estimates["method"] == "toy_method", "scope"]) == {"all", "5-15"}
    drawn = pd.read_csv(extended.folder / "figures/smoke/fig20_methods.csv")
    assert "toy_method" in set(drawn["method"])
    assert "toy_method" in (extended.folder / "figures/smoke/tables/surrogate.md").read_text()


def test_a_new_distribution_is_fitted_stored_and_shown(extended):
    law = json.loads((extended.folder / "results/smoke/models/two_pieces.json").read_text())
    tail = law["inverse_ttc"]["distributions"]["5-15"]["components"][-1]
    assert tail["kind"] == "toy exponential"
    chapter = (extended.folder / "results/smoke/book/03_piecewise_mixture_models.html").read_text()
    assert "toy exponential" in chapter


def test_a_new_vehicle_is_mapped_and_simulated(extended):
    maps = list(extended.folder.glob("results/vehicles/toy_car-*/vehicle.json"))
    assert len(maps) == 2  # up to the paper's cap, and without one for the answer
    assert {json.loads(path.read_text())["vehicle"] for path in maps} == {"toy_car"}
    exact = pd.read_csv(extended.folder / "results/smoke/exact.csv").set_index("segment")["probability"]
    crude = pd.read_csv(extended.folder / "results/smoke/crude.csv").set_index("segment").loc["all"]
    assert crude["ci95_low"] <= exact["all"] <= crude["ci95_high"]
