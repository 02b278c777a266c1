"""Draw the course of one estimate for fewruns/method.md: its runs, surrogate, clearances and intervals.

python benchmarks/samplers/method_figure.py
"""

from dataclasses import dataclass
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
from accelerated_evaluation.publishing.figures.style import COLUMN_WIDTH, paper_style
from fewruns import Estimate, Sampler, Stopping
from fewruns.arrays import Array, Flags
from fewruns.cover import clearances, find_open_balls
from fewruns.running import run_batches, sampler_for
from hidden_problems import hidden_problems
from matplotlib.axes import Axes
from matplotlib.patches import Circle
from problems import Problem

PATH = Path(__file__).resolve().parents[2] / "fewruns" / "method_course.svg"
PROBLEM, SEED = "plane_disc", 1  # an estimate in which the search missed the disc
GOAL = Stopping(maximum_simulations=1000)
REACH = 10.0  # of the axes, in normal scores
RATIOS = [0.4, 0.6, 0.8, 1.0, 1.5, 2.0, 3.0]  # ticks
GRID = np.meshgrid(*[np.linspace(-REACH, REACH, 200)] * 2)
POINTS = np.column_stack([each.ravel() for each in GRID])
LEGEND = {"loc": "upper center", "bbox_to_anchor": (0.5, -0.16), "ncols": 2}  # below the axes
PHASES = {  # name in the figure, marker and colour of each phase
    "search": ("search", "o", "#9ecae1"),
    "learn": ("learning", "v", "#4292c6"),
    "estimate": ("estimate", "s", "#08306b"),
    "cover": ("certificate", "^", "#d94801"),
}


@dataclass
class Moment:
    """What the sampler knew when the estimate began, and before it met the disc."""

    z: Array  # the runs, shape (n, d)
    happened: Flags
    probability: Array  # predicted by the surrogate on the grid
    batch: Array  # the runs of the last batch
    clearance: Array  # of the runs
    balls: Array  # that are open: centres and radii, shape (k, d + 1)


def moment(sampler: Sampler) -> Moment:
    """Return what a sampler knows now."""
    progress, required = sampler.progress, sampler.required
    known = np.vstack([progress.z[progress.happened], progress.centres])
    clearance = clearances(progress.z, progress.happened, progress.score, known)
    asked = required.share * sampler.estimate(GOAL).probability, 1 / required.curvature
    return Moment(
        progress.z,
        progress.happened,
        sampler.belief.probability(POINTS).reshape(GRID[0].shape),
        progress.z[-sampler.batch_size :],
        clearance,
        find_open_balls(progress.z, clearance, known, *asked, np.random.default_rng(0)),
    )


def draw_event(axes: Axes, problem: Problem, title: str) -> None:
    """Draw the event in grey, for a problem of two inputs."""
    happened = problem.event.evaluate(POINTS)[0].reshape(GRID[0].shape)
    axes.contourf(*GRID, happened, levels=[0.5, 1.5], colors=["#dddddd"])
    axes.set(xlim=(-REACH, REACH), ylim=(-REACH, REACH), aspect="equal", title=title)
    axes.set(xlabel="first normal score", ylabel="second normal score")


def draw_runs(axes: Axes, found: Estimate) -> None:
    """Draw all runs by phase."""
    for phase, (name, marker, colour) in PHASES.items():
        runs = found.tables["runs"]
        runs = runs[runs["phase"] == phase]
        axes.plot(runs["z_1"], runs["z_2"], marker, color=colour, label=f"{name}, {len(runs)}", markersize=3)
    axes.legend(**LEGEND)


def draw_surrogate(axes: Axes, now: Moment) -> None:
    """Draw the predicted probability of the event, and the batch that was chosen by it."""
    for level, line in ((0.1, ":"), (0.5, "-"), (0.9, "--")):
        axes.contour(*GRID, now.probability, levels=[level], colors="#4292c6", linestyles=line)
        axes.plot([], [], line, color="#4292c6", label=f"probability {level}")
    axes.plot(*now.z[~now.happened].T, ".", color="black", markersize=2, label="run without the event")
    axes.plot(*now.z[now.happened].T, "x", color="black", markersize=3, label="event")
    axes.plot(*now.batch.T, "s", color="#08306b", markersize=3.5, label="last batch")
    axes.legend(**LEGEND)


def draw_clearances(axes: Axes, now: Moment) -> None:
    """Draw how far around each run the event is excluded, and the centres of open balls."""
    for point, radius in zip(now.z, now.clearance, strict=True):
        axes.add_patch(Circle(point, radius, color="#4292c6", alpha=0.15, linewidth=0))
    axes.plot(*now.z.T, ".", color="black", markersize=2, label="run")
    axes.plot(*now.balls[:, :2].T, ",", color="#d94801", label="centre of an open ball")
    axes.legend(**LEGEND)


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
    axes.set(title="(d) estimate and 80 % interval", xlabel="runs", ylabel="estimate / exact", yscale="log")
    axes.set_yticks(RATIOS, [f"{ratio:g}" for ratio in RATIOS])
    axes.minorticks_off()


def main() -> None:
    """Draw the figure."""
    problem = hidden_problems()[PROBLEM]
    sampler, course, moments = sampler_for(problem.event, np.random.default_rng(SEED)), [], {}
    for _ in run_batches(sampler, problem.event, GOAL):
        course.append(sampler.estimate(GOAL))
        met = (sampler.progress.z[sampler.progress.happened, 0] < 0).any()  # whether a run is in the disc
        if course[-1].probability > 0 and not met:
            moments["last"] = moment(sampler)
            moments.setdefault("first", moments["last"])
    found = sampler.estimate(GOAL)
    with paper_style():
        figure, axes = plt.subplots(2, 2, figsize=(2 * COLUMN_WIDTH, 7.4), layout="constrained")
        titles = "(a) first estimate", "(b) clearances", "(c) all runs"
        for each, title in zip(axes.flat, titles, strict=False):
            draw_event(each, problem, title)
        draw_surrogate(axes[0, 0], moments["first"])
        draw_clearances(axes[0, 1], moments["last"])
        draw_runs(axes[1, 0], found)
        draw_course(axes[1, 1], course, problem.exact)
        figure.savefig(PATH, metadata={"Date": None})
        print(f"{PATH.name}: {found.probability / problem.exact:.2f} of the exact probability")


if __name__ == "__main__":
    main()
