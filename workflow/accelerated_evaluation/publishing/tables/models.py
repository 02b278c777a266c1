"""Readable tables of the records and their checks, of fitted models, and of candidate families."""

import json
from collections.abc import Mapping, Sequence

import pandas as pd

from accelerated_evaluation.laws.distributions import Distribution, Empirical, unit_to_power
from accelerated_evaluation.laws.paper.models import UNITS, IndependentLaw
from accelerated_evaluation.publishing.published import result_table, table
from accelerated_evaluation.publishing.tables.display import readable, reproducible_value
from accelerated_evaluation.publishing.tables.laws import interval_column

PARAMETER_DIGITS = 5  # significant digits of fitted parameters, of which the eighth depends on the processor
SYMBOLS = {"inverse_range": "R⁻¹", "inverse_ttc": "TTC⁻¹"}


def _rounded(account: pd.DataFrame) -> pd.DataFrame:
    """Return the account with short values of the variables, and all digits of the numbers of rows."""
    return account.map(lambda value: readable(value, 3) if isinstance(value, float) else value)


# The account of the records, one row for each filter; for other scenarios, for each variable.
account_table = result_table("encounters_account", result="account", digest=_rounded)


def _what_was_seen(report: pd.DataFrame) -> pd.DataFrame:
    """Return the columns that fit on a page; a notebook shows the others for checks that are not fine."""
    return report[["check", "verdict", "looked_at", "seen"]]


# The report on the records.
records_report_table = result_table("records_report", digits=3, digest=_what_was_seen)


def parameter_table(model: IndependentLaw) -> pd.DataFrame:
    """Tabulate the parameters of a lane-change model, one row for each parameter of each component.

    ``from`` and ``to`` are in the unit of the variable, and the weight of a component is its total weight.
    """
    laws = [("inverse_range", "all", model.inverse_range)]
    laws += [("inverse_ttc", segment, law) for segment, law in model.inverse_ttc.items()]
    rows = [
        {
            "variable": variable,
            "segment": segment,
            "from": leaf.lower,
            "to": leaf.upper,
            "unit": UNITS[variable],
            "weight": weight,
            "family": leaf.kind,
            "parameter": name,
            "value": getattr(leaf, name),
            "value_unit": unit_to_power(UNITS[variable], parameter.power),
        }
        for variable, segment, law in laws
        for weight, leaf in law.leaves()
        for name, parameter in leaf.parameters.items()
    ]
    return pd.DataFrame(rows)


def _of_two_pieces(parameters: pd.DataFrame) -> pd.DataFrame:
    """Return the parameters of the model with two pieces of R^-1, which the paper simulates.

    The limits of a piece and the parameter have their units in the same column.
    """
    rows = parameters[parameters["model"] == "two_pieces"]
    low, high, value = (rows[name].map(readable) for name in ("from", "to", "value"))
    return rows[["variable", "segment"]].assign(
        piece=low + " to " + high + " " + rows["unit"],
        weight=rows["weight"],
        family=rows["family"],
        parameter=rows["parameter"] + " " + value + " " + rows["value_unit"],
    )


@table("parameters", digits=PARAMETER_DIGITS, digest=_of_two_pieces)
def parameters_table(
    single: IndependentLaw, two_pieces: IndependentLaw, three_pieces: IndependentLaw
) -> pd.DataFrame:
    """Return the parameters of all fitted models (`parameter_table`), with the column ``model`` first."""
    models = {"single": single, "two_pieces": two_pieces, "three_pieces": three_pieces}
    tables = {name: parameter_table(model) for name, model in models.items()}
    return pd.concat(tables, names=["model"]).reset_index("model").reset_index(drop=True)


def _without_counts(dependence: pd.DataFrame) -> pd.DataFrame:
    """Return Kendall's tau of each pair of variables with its 95 % interval in one column."""
    pairs = dependence["pair"].str.replace("_", " ").str.replace("inverse ttc", "inverse TTC")
    ends = dependence["ci_low"], dependence["ci_high"]
    return dependence[["segment"]].assign(
        pair=pairs, tau=dependence["tau"], **{"95 %": interval_column(*ends)}
    )


@table("dependence", digits=3, digest=_without_counts)
def dependence_table(dependence: pd.DataFrame) -> pd.DataFrame:
    """Return Kendall's tau of each pair of variables, its size, and whether its interval excludes zero."""
    excludes = (dependence["ci_low"] > 0) | (dependence["ci_high"] < 0)
    return dependence.assign(size=dependence["tau"].abs(), excludes_zero=excludes)


# Ratios of the largest to the smallest quantile of TTC^-1 of the segments.
similarity_table = result_table("similarity", digits=3)


def rank_table(candidates: pd.DataFrame) -> pd.DataFrame:
    """Tabulate the ranks by AIC of all families, for R^-1 of all segments and TTC^-1 of each segment.

    The family with the smallest mean rank comes first; a dash means that it could not be fitted.
    """
    candidates = candidates[(candidates["segment"] == "all") | (candidates["variable"] == "inverse_ttc")]
    places = candidates["variable"].map(SYMBOLS) + ", " + candidates["segment"]
    shown = candidates["rank"].map(lambda rank: "–" if pd.isna(rank) else f"{rank:.0f}")
    labelled = candidates.assign(place=places, shown=shown)
    ranks = labelled.pivot_table(
        index="family", columns="place", values="shown", aggfunc="first", fill_value="–"
    )
    families = labelled.groupby("family")
    order = families["rank"].mean().sort_values(kind="stable").index
    ranks = ranks.loc[order, places.unique()].rename_axis(columns=None)
    parameters = families["n_parameters"].unique().map(lambda counts: " or ".join(map(str, sorted(counts))))
    ranks.insert(0, "parameters", parameters)
    return ranks.reset_index()


def without_mixtures(candidates: pd.DataFrame) -> pd.Series:
    """Return the rank of each fit by AIC among the common families, without the piecewise mixtures.

    Ranks are counted by variable and segment, and are NaN for the mixtures.
    """
    common = candidates[~candidates["family"].str.startswith("piecewise")]
    ranks = common.groupby(["variable", "segment"])["aic"].rank()
    return ranks.reindex(candidates.index)


@table("candidates", digits=5, digest=rank_table)
def candidates_table(candidates: pd.DataFrame) -> pd.DataFrame:
    """Return the table of the fits of all candidate families, for publication.

    The column ``parameters`` contains numbers as JSON, which are rounded to `PARAMETER_DIGITS` digits, and
    ``rank_without_mixtures`` the ranks of `without_mixtures`. Notebooks show the ranks of the families
    (`rank_table`) instead.
    """

    def rounded(text: str) -> str:
        parameters = json.loads(text).items()
        return json.dumps({name: reproducible_value(value, PARAMETER_DIGITS) for name, value in parameters})

    return candidates.assign(
        parameters=candidates["parameters"].map(rounded, na_action="ignore"),
        rank_without_mixtures=without_mixtures(candidates),
    )


def close_call_table(
    encounters: pd.DataFrame,
    models: Mapping[str, IndependentLaw],
    *,
    ranges: Sequence[float] = (30, 20, 10, 5, 3),
    ttcs: Sequence[float] = (10, 5, 3, 2),
) -> pd.DataFrame:
    """Compare how often cut-ins are closer than given limits in the records and in the models.

    The limits are ranges [m], pooled over the segments, and times to collision [s], by segment. ``empirical``
    is the share of the records.
    """
    first = next(iter(models.values()))
    pooled = {name: model.inverse_range for name, model in models.items()}
    rows = [_close_call("all", f"R < {r:g} m", encounters["inverse_range"], 1 / r, pooled) for r in ranges]
    for segment in first.segments:
        records = encounters.loc[encounters["segment"] == segment, "inverse_ttc"]
        laws = {name: model.inverse_ttc[segment] for name, model in models.items()}
        rows += [_close_call(segment, f"TTC < {t:g} s", records, 1 / t, laws) for t in ttcs]
    return pd.DataFrame(rows)


def _close_call(
    segment: str, name: str, records: pd.Series, x: float, laws: Mapping[str, Distribution]
) -> dict[str, str | float]:
    """Return a row with the number and share of records above x, and the probability of this in each law."""
    line = {"segment": segment, "cut_in": name, "events": int((records > x).sum())}
    line["empirical"] = float(Empirical(records).sf(x))
    return line | {key: float(law.sf(x)) for key, law in laws.items()}
