"""The rate of an event over several scenarios, each with its own exposure."""

from collections.abc import Mapping

import numpy as np
import pandas as pd

from accelerated_evaluation.answer.consequences.criterion import CONFIDENCE, Basis, Criterion, Judged
from accelerated_evaluation.answer.consequences.rates import Rate
from accelerated_evaluation.answer.ways.posterior import Posterior, summarise_bounds
from accelerated_evaluation.base.arrays import Array

SIZE = 20_000  # number of equally likely values of each rate
TOTAL = "together"


def rate_values(posterior: Posterior, rate: Rate | float, generator: np.random.Generator) -> Array:
    """Return bounds of equally likely values of the rate of an event in a scenario, shape (2, `SIZE`).

    ``posterior`` is the probability of the event in an encounter. ``rate`` is the posterior of the rate of
    encounters, or this rate itself if it is taken as known. Where the probability is unknown, the lower bound
    is 0; elsewhere the bounds are equal.
    """
    values = posterior.most
    draws, levels = generator.integers(len(values), size=SIZE), (np.arange(SIZE) + 0.5) / SIZE
    most = values[draws, generator.integers(values.shape[1], size=SIZE)]
    least = np.where(np.broadcast_to(posterior.unknown, len(values))[draws], 0.0, most)
    encounters = rate if isinstance(rate, float) else generator.permutation(rate.law.ppf(levels))
    return np.array([least, most]) * encounters


def total_table(rates: Mapping[str, Array], per: str, bases: Mapping[str, Basis]) -> pd.DataFrame:
    """Tabulate the rates of the scenarios and their sum.

    Parameters
    ----------
    rates
        Bounds of equally likely values of the rate of each scenario, shape (2, n) each (`rate_values`). The
        scenarios are taken as independent, because their laws are fitted to different records.
    per
        Unit of the rates, ``kilometre`` or ``hour``.
    bases
        What the rate of each scenario rests on.

    Returns
    -------
    pandas.DataFrame
        One row for each scenario and one for all together: mean, median and intervals
        (`summarise_bounds`), the one-sided 95 % upper bound ``upper95``, the ``share`` of the mean, the
        ``encounters`` whose rate it is, empty for all, and ``beyond``, the share that rests on predicted
        events unlike any record.
    """
    whole, rows = np.sum(list(rates.values()), axis=0), []
    bases = {**bases, TOTAL: basis_together(rates, bases)}
    for name, values in {**rates, TOTAL: whole}.items():
        summary = summarise_bounds(*values)
        row = {"scenario": name, "per": per, "mean": summary.pop("probability")} | summary
        row |= {
            "upper95": float(np.quantile(values[1], CONFIDENCE)),
            "share": values[0].mean() / whole[0].mean(),
        }
        rows.append(row | {"encounters": bases[name].encounters, "beyond": bases[name].beyond})
    return pd.DataFrame(rows)


def basis_together(rates: Mapping[str, Array], bases: Mapping[str, Basis]) -> Basis:
    """Return what the sum of rates rests on; the share beyond the records is weighted by the upper bounds."""
    names = [basis.encounters for basis in bases.values() if basis.encounters]
    means = {name: values[1].mean() for name, values in rates.items()}
    with np.errstate(invalid="ignore"):  # no vehicle has the event
        beyond = np.float64(sum(means[name] * bases[name].beyond for name in means)) / sum(means.values())
    low, high = np.sum([each.replayed for each in bases.values()], axis=0).tolist()
    return Basis(" and ".join(dict.fromkeys(names)), float(beyond), (low, high))


def judged_total(rates: Mapping[str, Array], per: str, bases: Mapping[str, Basis], limit: float) -> Judged:
    """Return the sum of the rates of all scenarios, judged by an upper limit."""
    least, most = np.sum(list(rates.values()), axis=0)[:, :, None]
    criterion = Criterion(f"{limit:g} per {per}", limit, per)
    return Judged(criterion, most, np.full_like(most, np.nan), basis_together(rates, bases), least=least)
