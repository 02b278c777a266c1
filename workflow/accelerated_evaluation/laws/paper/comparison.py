"""Compare the pieces of the fitted models with common families of distributions, variable by variable."""

from collections.abc import Iterable

import pandas as pd
from tqdm import tqdm

from accelerated_evaluation.base.errors import located
from accelerated_evaluation.distributions import PiecewiseMixture
from accelerated_evaluation.laws.paper.candidates import assessed_fit, compare, fit_candidates
from accelerated_evaluation.laws.paper.independent import IndependentLaw
from accelerated_evaluation.laws.paper.models import refit


def compare_with_candidates(
    encounters: pd.DataFrame, models: Iterable[IndependentLaw], variable: str, segment: str
) -> pd.DataFrame:
    """Fit the candidate families to one variable, and rank them together with the piecewise models by AIC.

    The piecewise models are fitted again to the same rows, with their knots. Knots count as parameters. Rows
    exactly at the lower end of the support (R = 75 m in the paper) are counted, but excluded from all fits,
    because a family whose density is zero or infinite there could not be fitted. The table has the columns
    ``variable``, ``segment``, ``rows``, ``rows_on_edge`` and those of `candidates.compare`. The segment
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
    comparison = compare(fits)
    labels = {"variable": variable, "segment": segment, **counts}
    return comparison.assign(**labels)[[*labels, *comparison.columns]]
