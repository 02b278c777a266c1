"""A second answer, from near misses alone: the probability of a crash without a law of the encounters.

The margin of a record is q = recorded value / first value at which the vehicle crashes, of the variable in
which crashes are an upper set (the closing speed of a cut-in), while the other variables keep their recorded
values. A record crashes if and only if q is at least 1. The largest margins are peaks over a threshold, so
their excess is modelled by a generalised Pareto distribution, and P(q >= 1) is the probability of a crash.
"""

from collections.abc import Callable

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from scipy.special import logsumexp
from scipy.stats import genpareto, norm

from accelerated_evaluation.answer.ways.near_misses import level_factors
from accelerated_evaluation.answer.ways.posterior import SUMMARY, Posterior, summarise
from accelerated_evaluation.base.arrays import Array
from accelerated_evaluation.methods.problem import Problem

LARGEST = (50, 100, 200, 400, 800)  # numbers of the largest margins that are fitted
CHOSEN = 200  # the number whose fit is the second answer
SHAPE_SD = 0.15  # standard deviation of the normal prior of the shape, whose mean is 0
SHAPES = np.linspace(-4 * SHAPE_SD, 4 * SHAPE_SD, 49)
# Natural logarithms of the scale divided by the mean excess; they contain the posterior for 50 margins.
LOG_SCALES = np.linspace(-1.2, 1.2, 97)
STEP = 1.06  # ratio of successive values at which the first crash is looked for
LEAST_MARGIN = 0.05  # margins below it are not computed
HALVINGS = 25  # of the interval that contains the first crash
AT_MOST = 0.1  # largest share of the records that is fitted as a tail
CURVE = np.linspace(0.0, 1.3, 131)  # margins at which the fitted curve is tabulated
COLUMNS = ["largest", "threshold", "near_crash", "crashed", *SUMMARY]
IN_CHOICES = f"near misses: the {CHOSEN} largest margins, without a law"

Crashes = Callable[[Array], NDArray[np.bool_]]


def record_margins(problem: Problem, records: Array) -> Array:
    """Return the margins of records, shape (n, d), for the vehicle of a problem; all 0 if they have none.

    There are no margins if crashes are no upper set in any variable of the scenario, or if the vehicle
    crashes by chance. Margins need some million simulations, so they are not computed for slow vehicles.
    """
    if not problem.upper_set or problem.deterministic is False:
        return np.zeros(len(records))
    axis = problem.scenario.names.index(problem.scenario.upper_set_in)
    return margins(lambda encounters: problem.simulate(encounters.T).crash, records.T, axis)


def margins(crashes: Crashes, records: Array, axis: int, count: int = max(LARGEST) + 1) -> Array:
    """Return the margin q of each record, shape (n,), which is 0 if it is not among the ``count`` largest.

    The variable ``axis`` of records, shape (d, n), is multiplied by growing factors until ``count`` records
    crash, and the factor of the first crash is then found by bisection. ``crashes`` returns whether each
    encounter of shape (d, m) ends in a crash.
    """

    def with_factor(rows: NDArray[np.intp], factor: Array | float) -> NDArray[np.bool_]:
        scaled = records[:, rows].copy()
        scaled[axis] *= factor
        return crashes(scaled)

    left = np.flatnonzero(records[axis] > 0)
    below, above = np.zeros(records.shape[1]), np.full(records.shape[1], np.inf)
    factor, found = 1.0, 0
    while left.size and found < count and factor <= 1 / LEAST_MARGIN:
        crashed = with_factor(left, factor)
        above[left[crashed]], below[left[~crashed]] = factor, factor
        found, left, factor = found + int(crashed.sum()), left[~crashed], factor * STEP
    rows = np.flatnonzero(np.isfinite(above))
    for _ in range(HALVINGS):
        middle = (below[rows] + above[rows]) / 2
        crashed = with_factor(rows, middle)
        above[rows[crashed]], below[rows[~crashed]] = middle[crashed], middle[~crashed]
    return 1 / above


def tail_posterior(excess: Array) -> tuple[Array, Array, Array]:
    """Return a grid of shapes and scales of a generalised Pareto distribution, and its probabilities, (m,).

    The prior of the shape is normal, and that of the logarithm of the scale is flat.
    """
    scales = excess.mean() * np.exp(LOG_SCALES)
    logs = [genpareto.logpdf(excess[:, None], shape, scale=scales).sum(axis=0) for shape in SHAPES]
    logs = np.array(logs) + norm.logpdf(SHAPES, scale=SHAPE_SD)[:, None]
    shape, scale = (each.ravel() for each in np.meshgrid(SHAPES, scales, indexing="ij"))
    return shape, scale, np.exp(logs - logsumexp(logs)).ravel()


def exceedances(
    q: Array, largest: int, at: Array, draws: int, generator: np.random.Generator
) -> tuple[float, Array]:
    """Return the threshold, and draws of the probability that a margin reaches each value ``at``, (draws, m).

    The threshold is the largest margin that is not fitted. The number of margins above it has the uncertainty
    of a Bayesian bootstrap of long blocks of records, so that clusters of critical records count as clusters.
    """
    ordered = np.sort(q)[::-1]
    threshold = ordered[largest]
    shape, scale, probability = tail_posterior(ordered[:largest] - threshold)
    chosen = generator.choice(shape.size, draws, p=probability)
    share = largest / q.size * level_factors(q > threshold, draws, generator)
    beyond = genpareto.sf(at - threshold, shape[chosen][:, None], scale=scale[chosen][:, None])
    return float(threshold), share[:, None] * beyond


def near_miss_answer(q: Array, draws: int, generator: np.random.Generator) -> pd.DataFrame:
    """Tabulate the crash probability from the largest margins, one row for each number of them in `LARGEST`.

    The columns are ``largest``, the number of fitted margins; their ``threshold``; ``near_crash``, how many
    of them are in the upper half between the threshold and a crash; ``crashed``, how many records crash; and
    those of `posterior.summarise`. A row is left out if fewer margins are known, or if it would need more
    than a tenth of the records.
    """
    rows = []
    for largest in LARGEST:
        if largest < np.count_nonzero(q) and largest <= AT_MOST * q.size:
            threshold, beyond = exceedances(q, largest, np.ones(1), draws, generator)
            row = {"largest": largest, "threshold": threshold}
            row |= {"near_crash": int((q > (1 + threshold) / 2).sum()), "crashed": int((q >= 1).sum())}
            rows.append(row | summarise(Posterior(beyond[:, 0], np.zeros(draws, int))))
    return pd.DataFrame(rows, columns=COLUMNS)


def as_choice(answer: pd.DataFrame) -> pd.DataFrame:
    """Return the row of `CHOSEN` in the form of a row of `choices.choice_table`; no row if there is none."""
    row = answer[answer["largest"] == CHOSEN]
    return row.assign(choice=IN_CHOICES)[["choice", *SUMMARY]]


def margin_curve(q: Array, draws: int, generator: np.random.Generator) -> pd.DataFrame:
    """Return the largest margins and the fit to the `CHOSEN` largest, for a figure.

    Rows of the ``kind`` "record" have a ``margin`` and the ``share`` of records with at least this margin,
    and rows of the kind "fit" the median of this share with its limits ``low80`` and ``high80``.
    """
    known = np.sort(q[q > 0])[::-1][: max(LARGEST)]
    ranks = np.arange(1, known.size + 1) / q.size
    parts = [pd.DataFrame({"kind": "record", "margin": known, "share": ranks})]
    if known.size > CHOSEN and AT_MOST * q.size >= CHOSEN:
        at = CURVE[known[CHOSEN] <= CURVE]
        _, beyond = exceedances(q, CHOSEN, at, draws, generator)
        low, middle, high = np.quantile(beyond, [0.1, 0.5, 0.9], axis=0)
        fit = {"kind": "fit", "margin": at, "share": middle, "low80": low, "high80": high}
        parts.append(pd.DataFrame(fit))
    return pd.concat(parts, ignore_index=True)
