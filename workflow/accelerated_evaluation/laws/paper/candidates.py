"""Fits of the candidate families: maximum likelihood, AIC, BIC and Kolmogorov-Smirnov distance.

The 18 families, their parameters and densities are listed in `candidate_families`.
"""

import json
from collections.abc import Callable, Iterable
from dataclasses import dataclass

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike
from tqdm import tqdm

from accelerated_evaluation.base.arrays import Array
from accelerated_evaluation.base.errors import InputError, located
from accelerated_evaluation.laws.distributions import PiecewiseMixture
from accelerated_evaluation.laws.paper.candidate_estimators import NoMaximumError
from accelerated_evaluation.laws.paper.candidate_families import FAMILIES, CandidateFamily
from accelerated_evaluation.laws.paper.models import IndependentLaw, refit


@dataclass(frozen=True)
class CandidateFit:
    """The fit of a model to a sample of size n.

    If the model cannot be fitted, `reason` says why and the criteria are NaN.
    """

    family: str
    parameters: dict[str, float]  # in the units of the sample
    n_parameters: int  # number k of free parameters
    log_likelihood: float = np.nan  # L, in nats, with densities per unit of the sample
    aic: float = np.nan  # 2 k - 2 L
    bic: float = np.nan  # k log n - 2 L
    ks_distance: float = np.nan  # Kolmogorov-Smirnov distance between the sample and the fit
    reason: str = ""  # why the model cannot be fitted; empty if there is a fit


def assessed_fit(
    name: str,
    logpdf: Callable[[Array], Array],
    cdf: Callable[[Array], Array],
    n_parameters: int,
    x: ArrayLike,
    *,
    parameters: dict[str, float] | None = None,
) -> CandidateFit:
    """Compute log-likelihood, AIC, BIC and KS distance of a model for the sample to which it was fitted.

    The fit has a reason instead if the log density is not finite at some value. InputError is raised if x is
    not a one-dimensional array of finite numbers.
    """
    x = np.sort(_checked(x))
    parameters = parameters or {}
    logs = logpdf(x)
    if not np.isfinite(logs).all():
        bad = np.count_nonzero(~np.isfinite(logs))
        return CandidateFit(
            name, parameters, n_parameters, reason=f"no finite density at {bad} of {x.size} values"
        )
    likelihood = float(np.sum(logs))
    below = cdf(x)
    steps = np.arange(x.size + 1) / x.size
    return CandidateFit(
        name,
        parameters,
        n_parameters,
        likelihood,
        aic=2 * n_parameters - 2 * likelihood,
        bic=n_parameters * float(np.log(x.size)) - 2 * likelihood,
        ks_distance=float(max((steps[1:] - below).max(), (below - steps[:-1]).max())),
    )


def fit_candidates(
    x: ArrayLike,
    lower: float,
    *,
    progress: Callable[[Iterable[CandidateFamily]], Iterable[CandidateFamily]] = iter,
) -> list[CandidateFit]:
    """Fit the 18 candidate families to one sample, each by maximum likelihood, in the order of `FAMILIES`.

    The lower end of the support is given and not estimated. The loop over families is wrapped by
    ``progress``. InputError is raised if x is not a one-dimensional array of finite numbers, or ``lower`` is
    not finite.
    """
    x = np.sort(_checked(x))
    if not np.isfinite(lower):
        raise InputError(
            "fit_candidates, lower",
            seen=f"{lower}",
            expected="a finite number",
            change="State the lower end of the support.",
        )
    return [_fit(family, x, lower) for family in progress(FAMILIES)]


def _fit(family: CandidateFamily, x: Array, lower: float) -> CandidateFit:
    try:
        estimates = family.fit(x, lower)
        law = family.freeze(lower, *estimates.values())
    except NoMaximumError as error:
        return CandidateFit(family.name, {}, len(family.parameters), reason=str(error))
    except (ZeroDivisionError, OverflowError):
        reason = "parameters beyond the range of numbers"
        return CandidateFit(family.name, {}, len(family.parameters), reason=reason)
    return assessed_fit(family.name, law.logpdf, law.cdf, len(estimates), x, parameters=estimates)


def _checked(x: ArrayLike) -> Array:
    x = np.asarray(x, dtype=float)
    if x.ndim != 1 or x.size == 0 or not np.isfinite(x).all():
        bad = np.flatnonzero(~np.isfinite(x.ravel()))
        raise InputError(
            "candidate families, sample" + (f", row {bad[0]}" if bad.size else ""),
            seen=f"{x.ravel()[bad[0]]}" if bad.size else f"shape {x.shape}",
            expected="one column of finite numbers",
            change="Select one variable and drop rows without a value.",
        )
    return x


def fits_table(fits: Iterable[CandidateFit]) -> pd.DataFrame:
    """Return a table of fits to one sample, in increasing order of AIC.

    Models that cannot be fitted come last and have no rank. Equal values of AIC share the smaller rank, from
    1, and ``parameters`` are JSON text.
    """
    table = pd.DataFrame([vars(fit) for fit in fits])
    rank = table["aic"].rank(method="min").astype("Int64")
    parameters = table.pop("parameters").map(json.dumps)
    table.insert(table.columns.get_loc("reason"), "rank", rank)
    table.insert(table.columns.get_loc("reason"), "parameters", parameters)
    return table.sort_values("rank", kind="stable", ignore_index=True)


def compare_with_candidates(
    encounters: pd.DataFrame, models: Iterable[IndependentLaw], variable: str, segment: str
) -> pd.DataFrame:
    """Fit the candidate families to one variable, and rank them together with the piecewise models by AIC.

    The piecewise models are fitted again to the same rows, with their knots. Knots count as parameters. Rows
    exactly at the lower end of the support (R = 75 m in the paper) are counted, but excluded from all fits,
    because a family whose density is zero or infinite there could not be fitted. The table has the columns
    ``variable``, ``segment``, ``rows``, ``rows_on_edge`` and those of `candidates.fits_table`. The segment
    ``all`` means all rows.
    """
    x = encounters.loc[(encounters["segment"] == segment) | (segment == "all"), variable].to_numpy()
    laws: dict[int, PiecewiseMixture] = {}
    for model in models:
        law = model.inverse_range if variable == "inverse_range" else model.inverse_ttc[segment]
        laws[len(law.components)] = law
    lower = next(iter(laws.values())).lower
    inside = x[x > lower]
    fits = fit_candidates(inside, lower, progress=tqdm)
    for pieces, law in laws.items():
        with located(f"{variable} in segment {segment}"):
            fitted = refit(law, inside)
        parameters = fitted.n_parameters + len(fitted.knots)
        fits.append(
            assessed_fit(f"piecewise ({pieces} pieces)", fitted.logpdf, fitted.cdf, parameters, inside)
        )
    counts = {"rows": inside.size, "rows_on_edge": x.size - inside.size}
    comparison = fits_table(fits)
    labels = {"variable": variable, "segment": segment, **counts}
    return comparison.assign(**labels)[[*labels, *comparison.columns]]
