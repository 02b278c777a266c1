"""A folder with a law file and the encounter table that it belongs to, as a study leaves them."""

from dataclasses import replace

import numpy as np
import pandas as pd
from accelerated_evaluation import cli, write_law
from accelerated_evaluation.laws.distributions import BoundedExponential, Empirical
from accelerated_evaluation.laws.paper.models import IndependentLaw
from accelerated_evaluation.records.segments import complete, write_encounters
from scipy.stats import norm

SPEEDS = np.linspace(5, 15, 1000)
LAW = IndependentLaw(
    description="made up for tests",
    counts={"5-15": 1000},
    inverse_range=BoundedExponential(rate=50, lower=1 / 75),
    inverse_ttc={"5-15": BoundedExponential(rate=15)},
    lead_speeds={"5-15": Empirical(SPEEDS)},
    closing_speed_max=23.49,
)


def write_law_folder(folder, closing_unit=1.0):
    """Write ``law.json`` and ``encounters.parquet``, and return their paths.

    The closing speeds of the table are multiplied by ``closing_unit``, as if their unit were wrong.
    """
    folder.mkdir(parents=True, exist_ok=True)
    generator = np.random.default_rng(1)
    scores = generator.permuted(
        norm.ppf((np.arange(len(SPEEDS)) + 0.5) / len(SPEEDS)) * np.ones((2, 1)), axis=1
    )
    free = replace(LAW, closing_speed_max=np.inf)
    _, range_, speed = free.from_normal_scores(np.vstack([np.zeros(len(SPEEDS)), scores]).T).T
    columns = {"lead_speed": generator.permutation(SPEEDS), "range": range_}
    raw = pd.DataFrame(columns | {"closing_speed": closing_unit * speed})
    encounters = complete(raw).assign(segment="5-15")
    write_encounters(folder / "encounters.parquet", encounters, "made up")
    write_law(folder / "law.json", LAW, encounters)
    return folder / "law.json", folder / "encounters.parquet"


def begin_campaign(folder, *options):
    """Begin a campaign in the current folder, and return a function that runs one step of it."""
    write_law_folder(folder)

    def step(name, *arguments):
        return cli.main(["campaign", name, "c.json", *map(str, arguments)])

    files = ("--law", "law.json", "--encounters", "encounters.parquet")
    known = ("--half-width", 0.5, "--seed", 4, "--deterministic", "yes", "--interval", "usual", "--no-limits")
    assert step("new", *files, *known, *options) == 0
    return step
