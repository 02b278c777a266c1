"""Crude Monte Carlo over all velocity segments: every cut-in drawn from f and simulated (table III).

It runs in batches, each with a generator of its own, and keeps the counts of every batch: interrupted and
resumed, shortened or extended, the same batches give the same results.
"""

import hashlib
import json
import os
import warnings
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from tqdm import tqdm

from accelerated_evaluation.files import read_json, write_json
from accelerated_evaluation.laws.lane_change_model import LaneChangeModel
from accelerated_evaluation.methods.intervals import binomial_interval
from accelerated_evaluation.problem import CutIn
from accelerated_evaluation.randomness import child_generator

ALL = "all"
Counts = dict[str, list[int]]  # simulations and crashes of one batch, by segment


@dataclass(frozen=True)
class Checkpoint:
    """The file that holds the counts of all finished batches of one work.

    Attributes
    ----------
    path
        Where it is.
    work
        Names the work, see `fingerprint`; the counts of another are not used.
    """

    path: str | os.PathLike
    work: str

    def read(self) -> list[Counts]:
        """Read the counts; none where there is no file, or, with a warning, that of another work."""
        if not Path(self.path).is_file():
            return []
        content = read_json(self.path)
        if content["work"] != self.work:
            warnings.warn(f"{self.path} is of other inputs or settings; starting anew", stacklevel=2)
            return []
        return content["batches"]

    def write(self, batches: list[Counts]) -> None:
        """Write the counts, atomically."""
        write_json(self.path, {"work": self.work, "batches": batches})


def fingerprint(paths: Iterable[str | os.PathLike], settings: Mapping[str, Any]) -> str:
    """Return a digest of the files and settings that a work depends on; it changes with any of them."""
    files = {str(path): hashlib.sha256(Path(path).read_bytes()).hexdigest() for path in paths}
    return hashlib.sha256(json.dumps([files, settings], sort_keys=True).encode()).hexdigest()


def simulate_batch(
    problems: Mapping[str, CutIn], model: LaneChangeModel, generator: np.random.Generator, size: int
) -> Counts:
    """Simulate ``size`` cut-ins: a segment by its share, v_L as recorded there, R^-1 and TTC^-1 from f."""
    shares = [model.share(segment) for segment in problems]
    counts = {}
    for (segment, problem), count in zip(
        problems.items(), generator.multinomial(size, shares).tolist(), strict=True
    ):
        lead_speed = problem.lead_speed.rvs(generator, count)
        inverse_range = problem.model.inverse_range.rvs(generator, count)
        inverse_ttc = problem.model.inverse_ttc.rvs(generator, count)
        crash = problem.simulate(lead_speed, inverse_range, inverse_ttc).crash
        counts[segment] = [count, int(np.count_nonzero(crash))]
    return counts


def simulate_batches(
    problems: Mapping[str, CutIn],
    model: LaneChangeModel,
    checkpoint: Checkpoint,
    *,
    seed: int,
    batches: int,
    batch_size: int,
    save_every: int,
) -> list[Counts]:
    """Simulate the batches that the checkpoint does not hold, and return the counts of all.

    Parameters
    ----------
    problems, model
        The cut-ins of each segment, and the model that gives its share.
    checkpoint
        Written after every ``save_every`` batches and at the end.
    seed
        Root seed; batch k has the child ("crude", k).
    batches, batch_size
        How many batches, and the simulations of each.
    """
    done = checkpoint.read()
    with tqdm(
        desc="crude Monte Carlo",
        total=batches * batch_size,
        initial=min(len(done), batches) * batch_size,
        unit=" simulations",
        unit_scale=True,
    ) as progress:
        for batch in range(len(done), batches):
            done.append(simulate_batch(problems, model, child_generator(seed, "crude", batch), batch_size))
            if len(done) % save_every == 0 or len(done) == batches:
                checkpoint.write(done)
            progress.update(batch_size)
    return done[:batches]


def crude_estimates(batches: list[Counts], alpha: float) -> pd.DataFrame:
    """Estimate the crash probability of each segment and of all.

    Returns
    -------
    pandas.DataFrame
        Columns ``segment``, ``simulations``, ``crashes``, ``probability``, and the exact intervals ``ci_low``
        and ``ci_high`` at 100 (1 - alpha) %, ``ci95_low`` and ``ci95_high`` at 95 %. Without a crash they
        are an upper bound alone, from 0.
    """
    segments = {segment: np.sum([counts[segment] for counts in batches], axis=0) for segment in batches[0]}
    totals = segments | {ALL: sum(segments.values())}
    rows = []
    for segment, (simulations, crashes) in totals.items():
        row = {"segment": segment, **_estimate(int(simulations), int(crashes), alpha)}
        interval = binomial_interval(row["crashes"], row["simulations"], 0.05)
        rows.append(row | {"ci95_low": interval.low, "ci95_high": interval.high})
    return pd.DataFrame(rows)


def crude_course(batches: list[Counts], alpha: float) -> pd.DataFrame:
    """Follow the estimate over all segments batch by batch; columns as in `crude_estimates`, without 95 %."""
    counts = np.cumsum([np.sum(list(batch.values()), axis=0) for batch in batches], axis=0)
    return pd.DataFrame([_estimate(simulations, crashes, alpha) for simulations, crashes in counts.tolist()])


def _estimate(simulations: int, crashes: int, alpha: float) -> dict[str, float]:
    interval = binomial_interval(crashes, simulations, alpha)
    return {
        "simulations": simulations,
        "crashes": crashes,
        "probability": crashes / simulations,
        "ci_low": interval.low,
        "ci_high": interval.high,
    }
