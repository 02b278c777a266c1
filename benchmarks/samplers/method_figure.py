"""Draw the course of one estimate for docs/method.md: its runs, and its intervals after each batch.

python benchmarks/samplers/method_figure.py
"""

from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
from accelerated_evaluation.publishing.figures.style import COLUMN_WIDTH, paper_style
from fewruns import Estimate, Stopping
from fewruns.running import estimate_problem
from hidden_problems import hidden_problems
from matplotlib.axes import Axes
from public_problems import PublicProblem

PATH = Path(__file__).resolve().parents[2] / "docs" / "method_course.svg"
PROBLEM, SEED = "plane_disc", 0
PHASES = {  # name in the figure, marker and colour of each phase
    "search": ("search", "o", "#9ecae1"),
    "learn": ("learning", "v", "#4292c6"),
    "estimate": ("estimate", "s", "#08306b"),
    "cover": ("certificate", "^", "#d94801"),
}


def draw_runs(axes: Axes, found: Estimate, problem: PublicProblem) -> None:
    """Draw the runs by phase over the event, for a problem of two inputs."""
    x, y = np.meshgrid(*[np.linspace(-10, 10, 300)] * 2)
    happened = problem.event.evaluate(np.column_stack([x.ravel(), y.ravel()]))[0].reshape(x.shape)
    axes.contourf(x, y, happened, levels=[0.5, 1.5], colors=["#dddddd"])
    for phase, (name, marker, colour) in PHASES.items():
        runs = found.tables["runs"]
        runs = runs[runs["phase"] == phase]
        axes.plot(runs["z_1"], runs["z_2"], marker, color=colour, label=f"{name}, {len(runs)}", markersize=3)
    axes.set(xlim=(-10, 10), ylim=(-10, 10), aspect="equal", title="(a) runs")
    axes.set(xlabel="first normal score", ylabel="second normal score")
    axes.legend(loc="upper left", frameon=True)


def draw_course(axes: Axes, course: list[Estimate], exact: float) -> None:
    """Draw the estimate and its 80 % interval after each batch, divided by the exact probability."""
    known = [each for each in course if each.probability > 0 and np.isfinite(each.high) and each.high < 1]
    runs = [each.simulations for each in known]
    low, middle, high = (
        np.array([getattr(each, name) for each in known]) / exact for name in ("low", "probability", "high")
    )
    axes.vlines(runs, low, high, color="#4292c6", linewidth=1)
    axes.plot(runs, middle, "s", color="#08306b", markersize=2.5)
    axes.axhline(1.0, color="black", linewidth=0.8)
    axes.set(title="(b) estimate and 80 % interval", xlabel="runs", ylabel="estimate / exact", yscale="log")


def main() -> None:
    """Draw the figure."""
    problem, course = hidden_problems()[PROBLEM], []
    goal = Stopping(maximum_simulations=1000)
    found = estimate_problem(problem.event, np.random.default_rng(SEED), goal, on_batch=course.append)
    with paper_style():
        figure, (left, right) = plt.subplots(1, 2, figsize=(2 * COLUMN_WIDTH, 3.2))
        draw_runs(left, found, problem)
        draw_course(right, course, problem.exact)
        figure.savefig(PATH, metadata={"Date": None})
        print(f"{PATH.name}: {found.probability / problem.exact:.2f} of the exact probability")


if __name__ == "__main__":
    main()
