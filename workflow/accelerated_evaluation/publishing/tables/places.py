"""Where each of our numbers in the table of claims stands: published tables, rows, and a formula.

A place such as ``needed[scope=all; method=single].simulations`` names a published table, the rows that have
the given values in columns, and the column of the number. ``largest`` and ``smallest`` as a value mean the
rows, among those that the conditions before it leave, with the extreme value in that column. If several rows
are left, the number is the mean over them.
"""

from typing import NamedTuple

_NEEDED = "needed[scope=all; method={}].simulations"
_SEARCHED = "table2_computation[stage=Cross-Entropy; method={}; quantity=simulations].ours"
_REPEATED = "repeated_searches[crash_updates=smallest; method={}].{}"
_SETTLED = "repeated_searches[crash_updates=largest; method=piecewise].{}"
_RUN = "estimates[scope=all; method={}; replicate=0].simulations"
_KEPT = "encounters_account[step=range].rows_kept"


class Found(NamedTuple):
    """The origin of a published number: a formula in the letters a, b, ..., and one place for each letter."""

    formula: str
    places: tuple[str, ...]

    def columns(self) -> dict[str, str]:
        """Return the columns ``table``, ``rows`` and ``formula`` of the table of claims."""
        lettered = [f"{letter}: {place}" for letter, place in zip("abcd", self.places, strict=False)]
        tables = dict.fromkeys(place.partition("[")[0] for place in self.places)
        return {"table": ", ".join(tables), "rows": " | ".join(lettered), "formula": self.formula}


def _single_over_piecewise(place: str) -> tuple[str, str]:
    """Return a place for the method single, and the same for piecewise; ``{}`` stands for the method."""
    return place.format("single"), place.format("piecewise")


_saving = Found("1 - b / a", _single_over_piecewise(_NEEDED))
_crude = Found("a / b", (_NEEDED.format("crude"), _NEEDED.format("piecewise")))


def _one(place: str) -> Found:
    return Found("a", (place,))


FOUND = {
    "probability": _one("exact[segment=all].probability"),
    "probability_low": _one("pooled[scope=all; method=piecewise].ci_low"),
    "probability_high": _one("pooled[scope=all; method=piecewise].ci_high"),
    "piecewise": _one("table1_sample_size[method=piecewise].simulations"),
    "single": _one("table1_sample_size[method=single].simulations"),
    "crude": _one("table1_sample_size[method=crude].simulations"),
    "ratio_single": Found("a / b", _single_over_piecewise(_NEEDED)),
    "ratio_crude": _crude,
    "piecewise_run": _one(_RUN.format("piecewise")),
    "single_run": _one(_RUN.format("single")),
    "saving_run": Found("1 - b / a", _single_over_piecewise(_RUN)),
    "saving": _saving,
    "search_piecewise": _one(_SEARCHED.format("piecewise")),
    "search_single": _one(_SEARCHED.format("single")),
    "moved_piecewise": _one(
        "table2_computation[stage=Cross-Entropy; method=piecewise; quantity=parameters].ours"
    ),
    "moved_single": _one("table2_computation[stage=Cross-Entropy; method=single; quantity=parameters].ours"),
    "fitted_piecewise": _one("table2_computation[stage=fitting; method=piecewise].ours"),
    "fitted_single": _one("table2_computation[stage=fitting; method=single].ours"),
    "identified": _one(_KEPT),
    "closing": _one(_KEPT),
    "independent": _one("dependence[size=largest].tau"),
    "pareto": _one("candidates[variable=inverse_range; family=Pareto; segment=all].rank_without_mixtures"),
    "exponential": _one(
        "candidates[variable=inverse_ttc; family=exponential; rank_without_mixtures=smallest]"
        ".rank_without_mixtures"
    ),
    "similar": _one("similarity[quantile=0.95].ratio"),
    "same_tail": Found(
        "a / b",
        tuple(
            f"parameters[model={model}; variable=inverse_range; from=largest].value"
            for model in ("three_pieces", "two_pieces")
        ),
    ),
    "settled_ttc": _one(_SETTLED.format("change_inverse_ttc")),
    "settled_range": _one(_SETTLED.format("change_inverse_range")),
    "same_estimate": Found("a / b", _single_over_piecewise("pooled[scope=all; method={}].pooled")),
    "faster_search": Found(
        "(a + b) / (c + d)",
        tuple(
            _REPEATED.format(method, column)
            for method in ("single", "piecewise")
            for column in ("simulations", "needed")
        ),
    ),
    "faster_all": Found(
        "(a + b) / (c + d)",
        tuple(place.format(method) for method in ("single", "piecewise") for place in (_SEARCHED, _NEEDED)),
    ),
    "half": _saving,
    "faster": _crude,
    "orders": Found("log10(a / b)", _crude.places),
    "heuristic": Found(
        "a / b", (_REPEATED.format("piecewise", "needed"), _REPEATED.format("heuristic", "needed"))
    ),
    "shifted": Found(
        "a / b", (_REPEATED.format("piecewise", "needed"), _REPEATED.format("shifted", "needed"))
    ),
}
