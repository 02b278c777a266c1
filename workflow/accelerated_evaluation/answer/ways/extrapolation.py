"""How far the predicted events lie beyond the records, and how much of the answer rests on them.

Events that are predicted for a vehicle are weighted places: points or small intervals, with a probability
under each draw of the law. They are divided into parts by their distance from the records. For cut-ins the
distance is measured by the closing speed, and for other scenarios by the distance to the nearest record in
normal scores. The same table then shows the share of each part, for answers from crash maps, from few runs
and from many simulations.
"""

import numpy as np
import pandas as pd
import scipy
from numpy.typing import NDArray
from scipy.spatial import cKDTree
from scipy.special import ndtri

from accelerated_evaluation.answer.candidates.fitted_records import FittedRecords
from accelerated_evaluation.answer.ways.answer import Answer
from accelerated_evaluation.answer.ways.posterior import Posterior, summarise
from accelerated_evaluation.base.arrays import Array
from accelerated_evaluation.base.checking import checked
from accelerated_evaluation.base.percent import in_percent

ALL, RECORDED, NEAR, FAR = "all", "recorded", "near", "far"
DISJOINT = (RECORDED, NEAR, FAR)
DRAWN = 2000  # number of events that are drawn from the mean of the draws
CAPPED, HOST_UNSEEN = "above the cap", "host faster than recorded"
CAP = 23.49  # [m/s], the authors' cap on closing speeds, which this study does not apply
LIKE_RANGE = 5.0  # [m], difference below which two ranges are similar
LIKE_SPEED = 1.0  # [m/s], difference below which two lead speeds are similar
USUAL = 0.95  # share of the records whose nearest other record is so near that an event there is "recorded"

Parts = dict[str, NDArray[np.bool_]]


def largest_near(at: Array, recorded: Array, values: Array, within: float) -> Array:
    """For each coordinate, return the largest value of the records at a similar one; 0 if there is none.

    The coordinates ``at`` have shape (m,), the result too; coordinates ``recorded`` and ``values`` of the
    records have shape (n,). Coordinates are similar if their difference is less than ``within``.
    """
    order = np.argsort(recorded)
    recorded, values = recorded[order], values[order]
    first = np.searchsorted(recorded, at - within, side="right")
    end = np.searchsorted(recorded, at + within, side="left")
    return np.array([values[i:k].max(initial=0.0) for i, k in zip(first, end, strict=True)])


def speed_limits(records: Array, lead_speed: Array, range_: Array) -> dict[str, Array]:
    """Return the closing speeds [m/s] above which a cut-in is unlike the records, each of shape (m,).

    Above that of `NEAR` it is faster than all records at a similar range, above that of `FAR` faster than all
    records, and above that of `HOST_UNSEEN` the host is faster than all recorded hosts behind a similar lead
    speed. The records have the columns lead speed [m/s], range [m] and closing speed [m/s].
    """
    lead, ranges, closing = records.T
    return {
        NEAR: largest_near(range_, ranges, closing, LIKE_RANGE),
        FAR: np.full(range_.size, closing.max()),
        CAPPED: np.full(range_.size, CAP),
        HOST_UNSEEN: np.maximum(largest_near(lead_speed, lead, lead + closing, LIKE_SPEED) - lead_speed, 0.0),
    }


def parts_by_speed(records: Array, cut_ins: Array) -> Parts:
    """Return which cut-ins, (m, 3), are in each part; the parts `RECORDED`, `NEAR` and `FAR` are disjoint.

    Columns of records and cut-ins are lead speed [m/s], range [m] and closing speed [m/s].
    """
    limits = speed_limits(records, cut_ins[:, 0], cut_ins[:, 1])
    above = {name: cut_ins[:, 2] > limit for name, limit in limits.items()}
    return {RECORDED: ~above[NEAR]} | above | {NEAR: above[NEAR] & ~above[FAR]}


def parts_by_distance(records: Array, events: Array) -> Parts:
    """Return which events, (m, d), are in each part, by the distance to the nearest record, (n, d).

    The distance is that of `rank_scores`. An event is `RECORDED` if it is as near to a record as 95 % of the
    records are to another one, and `FAR` if it is farther than the most isolated record is.
    """
    tree = cKDTree(rank_scores(records, records))
    isolation = tree.query(tree.data, 2)[0][:, 1]
    usual, largest = np.quantile(isolation, USUAL), isolation.max()
    distance = tree.query(rank_scores(records, events))[0]
    return {
        RECORDED: distance <= usual,
        NEAR: (distance > usual) & (distance <= largest),
        FAR: distance > largest,
    }


def parts_of(records: FittedRecords, x: Array) -> Parts:
    """Return which encounters x, (m, d), are in each part, by the distance that fits the records."""
    divide = parts_by_distance if records.in_clusters else parts_by_speed
    return divide(records.x, x)


def rank_scores(records: Array, x: Array) -> Array:
    """Return normal scores of x, (m, d), by the ranks of each variable among the records, (n, d).

    Beyond the records a score grows by 1 over each standard deviation of the variable.
    """
    scores = np.empty(x.shape)
    for k, values in enumerate(np.sort(records, axis=0).T):
        ranks = ndtri((np.arange(values.size) + 0.5) / values.size)
        beyond = x[:, k] - np.clip(x[:, k], values[0], values[-1])
        scores[:, k] = np.interp(x[:, k], values, ranks) + beyond / values.std()
    return scores


@checked()
def extrapolation(
    answer: Answer, records: FittedRecords, replayed: NDArray[np.bool_] | None = None
) -> pd.DataFrame:
    """Divide the probability of the event among its parts by their distance from the records.

    ``replayed`` says for each record whether it ends in the event if the vehicle replays it, shape (n,). The
    table is that of `extrapolation_table`; it is empty if no event is known.

    Examples
    --------
    >>> import accelerated_evaluation as ae
    >>> draws = ae.choose_draws("independent_variables", ae.read_records("left_turn"))
    >>> found = ae.evaluate(ae.Problem("left_turn", "acc_aeb"), draws, ae.Simulations(20_000), generator=1)
    >>> table = ae.extrapolation(found, ae.read_records("left_turn"))
    >>> len(table) > 0
    True
    """
    if answer.crashes is None or answer.posterior is None:
        return pd.DataFrame(columns=["part"])
    found = parts_of(records, answer.crashes.x)
    of_records = None if replayed is None else parts_of(records, records.x[replayed])
    return extrapolation_table(found, answer.crash_weights, records.size, of_records)


def drawn_crashes(answer: Answer, records: FittedRecords, generator: np.random.Generator) -> pd.DataFrame:
    """Return `DRAWN` events of an answer, drawn from the mean of the draws, with the ``part`` of each."""
    names = list(answer.problem.scenario.names)
    if answer.crashes is None or not answer.crashes.weights.any():
        return pd.DataFrame(columns=[*names, "part"])
    x = answer.crashes.drawn(DRAWN, generator)
    parts = parts_of(records, x)
    part = np.select([parts[name] for name in DISJOINT], DISJOINT, "")
    return pd.DataFrame(x, columns=names).assign(part=part)


def extrapolation_table(
    parts: Parts, weights: Array, size: int, replayed: Parts | None = None
) -> pd.DataFrame:
    """Divide the probability of an event among the parts of the predicted events.

    Parameters
    ----------
    parts
        Which of the m predicted events are in each part, shape (m,) each.
    weights
        Probability that each event represents under each draw of the law, shape (K, m).
    size
        Number of distinct records.
    replayed
        The parts of those records that end in the event if the vehicle replays them; None if it does not.

    Returns
    -------
    pandas.DataFrame
        One row for all events and one for each ``part``: its ``share`` of the mean probability; the mean
        ``probability`` of an event in the part, the ``median`` and the ends of its credible intervals as in
        `summarise`; ``upper95``, its one-sided 95 % upper bound; the number of ``records``; ``expected``,
        the mean number of events among as many encounters; ``recorded``, the number of replayed records that
        end in the event; and ``replay_low95`` and ``replay_high95``, the exact 95 % interval (Clopper and
        Pearson 1934) of the probability that follows from this number without any model.
    """
    everything = np.ones(weights.shape[1], dtype=bool)
    rows, total = [], float(weights.sum(axis=1).mean())
    for part, inside in ({ALL: everything} | parts).items():
        probabilities = weights @ inside
        mean = float(probabilities.mean())
        row = {"part": part, "share": mean / total if total else np.nan}
        row |= summarise(Posterior(probabilities, np.zeros(len(weights), dtype=int)))
        row["upper95"] = float(np.quantile(probabilities, 0.95))
        row |= {"records": size, "expected": size * mean}
        row |= dict.fromkeys(("recorded", "replay_low95", "replay_high95"), np.nan)
        if replayed is not None:
            count = len(replayed[RECORDED]) if part == ALL else int(replayed[part].sum())
            row["recorded"] = count
            row["replay_low95"], row["replay_high95"] = exact_interval(count, size)
        rows.append(row)
    return pd.DataFrame(rows)


def exact_interval(count: int, size: int, level: float = 0.95) -> tuple[float, float]:
    """Return the exact interval of a probability from a binomial count (Clopper and Pearson 1934).

    Each end is also the one-sided bound of the level ``(1 + level) / 2``.
    """
    outside = (1 - level) / 2
    low = float(scipy.stats.beta.ppf(outside, count, size - count + 1)) if count else 0.0
    return low, float(scipy.stats.beta.isf(outside, count + 1, size - count)) if count < size else 1.0


def beyond_in_words(table: pd.DataFrame) -> str:
    """Return how many of the predicted events lie beyond the records, as text, for either kind of parts."""
    rows = table.set_index("part")
    beyond, far = rows["share"][NEAR] + rows["share"][FAR], rows["share"][FAR]
    near, farthest = "are farther from every record than records usually are", "farther than any of them"
    if HOST_UNSEEN in rows.index:  # the parts are those of `parts_by_speed`
        near, farthest = "close faster than any record at a similar range", "faster than any record at all"
    return f"{in_percent(beyond)} of the predicted events {near}, {in_percent(far)} {farthest}"


def extrapolation_in_words(table: pd.DataFrame) -> str:
    """Return a line of text that says how much of an answer lies beyond the records."""
    rows = table.set_index("part")["probability"]
    return (
        f"beyond the records: {beyond_in_words(table)}; without them the mean would be "
        f"{rows[RECORDED]:.2g} instead of {rows[ALL]:.2g}"
    )
