"""Fit the candidate families to one variable in one segment, and the piecewise models beside them."""

import pandas as pd
from accelerated_evaluation.distributions import PiecewiseMixture
from accelerated_evaluation.files import write_csv
from accelerated_evaluation.fitting.candidates import compare, fit_candidates, score
from accelerated_evaluation.jobs import job
from accelerated_evaluation.laws.lane_change_model import read_model
from accelerated_evaluation.laws.paper import refit
from tqdm import tqdm


def main(encounters: str, models: list[str], variable: str, segment: str, table: str) -> None:
    """Write the table of all families and models, best AIC first; knots count as parameters.

    Rows exactly on the edge of the support (R = 75 m) are counted and left out for all alike: they would
    rule out every family whose density is zero or infinite there.
    """
    rows = pd.read_parquet(encounters)
    x = rows.loc[(rows["segment"] == segment) | (segment == "all"), variable].to_numpy()
    laws: dict[int, PiecewiseMixture] = {}
    for path in models:
        model = read_model(path)
        law = model.inverse_range if variable == "inverse_range" else model.inverse_ttc[segment]
        laws[len(law.components)] = law
    inside = x[x > law.lower]
    fits = fit_candidates(inside, law.lower, progress=tqdm)
    for pieces, law in laws.items():
        fitted = refit(law, inside)
        parameters = fitted.n_parameters + len(fitted.knots)
        fits.append(score(f"piecewise ({pieces} pieces)", fitted.logpdf, fitted.cdf, parameters, inside))
    comparison = compare(fits)
    comparison.insert(0, "variable", variable)
    comparison.insert(1, "segment", segment)
    comparison.insert(2, "rows", inside.size)
    comparison.insert(3, "rows_on_edge", x.size - inside.size)
    write_csv(table, comparison)


if __name__ == "__main__":
    with job(snakemake.log[0]):
        main(
            snakemake.input.encounters,
            list(snakemake.input.models),
            snakemake.wildcards.variable,
            snakemake.wildcards.segment,
            snakemake.output.table,
        )
