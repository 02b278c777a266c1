"""What the paper states, in numbers and in words, and reasons why ours may differ."""

from dataclasses import dataclass
from typing import Any

PAPER_PROBABILITY = 7.4e-7  # section VI.C
PAPER_SIMULATIONS = {"piecewise": 7840, "single": 12320, "crude": 5.5e7}  # table I
PAPER_RATIOS = {"piecewise": 1, "single": 1.57, "crude": 7e3}  # table I
PAPER_SEARCHES = {"piecewise": 24000, "single": 30000}  # table II
PAPER_PARAMETERS = {"piecewise": 18, "single": 4}  # table II, of fitting and of Cross-Entropy
# Settings that a study must have in common with the paper; otherwise their numbers are not comparable.
PREMISES: dict[str, Any] = {
    "data.source": "spmd",
    "data.sample": None,
    "vehicle.name": "acc_aeb",
    "vehicle.parameters": {},
    "importance_sampling.alpha": 0.2,
    "importance_sampling.beta": 0.2,
}

# Kinds of claims. The first two have no verdict of their own.
COUNT = "count"  # a number of things, known exactly
DERIVED = "derived"  # a number that follows from numbers in other rows
MEASURED = "measured"  # any other number
STATED = "stated"  # a statement in words; the number to expect if it is right
ABOVE = "above"  # the same, but the number need only be above that of the row

_KNOTS = (
    "the paper does not print its knots; ours is exact for the TTC^-1 knots at the configured quantiles, and "
    "table sensitivity shows how it moves with them: on the SPMD events the paper's number lies between "
    "those for knots at the 90 % and the 95 % quantiles"
)
_SEARCH = (
    "the number measures how close f* comes to f given a crash; the paper prints neither the knots nor the "
    "thresholds that led to its f*, so its search cannot be repeated step by step"
)
_COUNTS = "it follows from the numbers of simulations above"
_INTERVAL = "the interval is that of a different probability, see above"
_CRUDE = "it is inverse to the crash probability, see there"
_ADAPTIVE = (
    "the paper's amounts to {} iterations of 1000 in each of three segments; ours goes on in each segment "
    "until the crash itself was the event of two updates in a row, however rare it is there"
)
_RATES = (
    "the search moves the rates of R^-1 and TTC^-1 in each of the segments; the paper counts those of its "
    "fit, which has one R^-1 for all"
)
_PIECES = "the paper's count belongs to two pieces of R^-1, two of TTC^-1, and three segments"
_LAWS = "the paper's count belongs to one law of R^-1 and one of TTC^-1 in each of three segments"


@dataclass(frozen=True)
class Claim:
    """A number or another statement of the paper."""

    claim: str  # what the number means
    source: str  # where in the paper it is stated
    paper: float  # the paper's number, or the number to expect if its statement is right
    tolerance: float  # half a unit of the last printed digit, or half the width of an interval
    reason: str  # why ours may differ
    kind: str = MEASURED
    rests_on_study: bool = True  # whether the number depends on the data, the vehicle and the settings


def _claim(*values: Any) -> Claim:  # noqa: ANN401
    return Claim(*values)


NUMBERS = {
    "probability": Claim(
        "crash probability of one lane change", "section VI.C", PAPER_PROBABILITY, 0.4e-7, _KNOTS
    ),
    "probability_low": Claim(
        "80 % interval of it, lower end", "section VI.C", 7.0e-7, 0.05e-7, _INTERVAL, DERIVED
    ),
    "probability_high": Claim(
        "80 % interval of it, upper end", "section VI.C", 7.8e-7, 0.05e-7, _INTERVAL, DERIVED
    ),
    "piecewise": Claim(
        "simulations to converge, piecewise, mean", "table I", PAPER_SIMULATIONS["piecewise"], 0.5, _SEARCH
    ),
    "single": Claim(
        "simulations to converge, single, mean", "table I", PAPER_SIMULATIONS["single"], 0.5, _SEARCH
    ),
    "crude": _claim(
        *("simulations to converge, crude Monte Carlo", "table I", PAPER_SIMULATIONS["crude"]),
        *(0.05e7, _CRUDE, DERIVED),
    ),
    "ratio_single": Claim("single / piecewise", "table I", PAPER_RATIOS["single"], 0.005, _SEARCH),
    "ratio_crude": Claim("crude / piecewise", "table I", PAPER_RATIOS["crude"], 0.5e3, _SEARCH),
    "piecewise_run": Claim("simulations to converge, piecewise, one run", "section VI.C", 7800, 50, _SEARCH),
    "single_run": Claim("simulations to converge, single, one run", "section VI.C", 13800, 50, _SEARCH),
    "saving_run": Claim("share saved by piecewise, one run", "section VI.C", 0.44, 0.005, _COUNTS, DERIVED),
    "saving": _claim(
        *("share saved by piecewise, mean", "section VII", 0.33, 0.005),
        "the paper's own table I gives 36 %",
    ),
    "search_piecewise": _claim(
        *("Cross-Entropy simulations, piecewise", "table II", PAPER_SEARCHES["piecewise"], 500),
        _ADAPTIVE.format(8),
    ),
    "search_single": _claim(
        *("Cross-Entropy simulations, single", "table II", PAPER_SEARCHES["single"], 500),
        _ADAPTIVE.format(10),
    ),
    "moved_piecewise": _claim(
        *("Cross-Entropy parameters, piecewise", "table II", PAPER_PARAMETERS["piecewise"], 0, _PIECES),
        *(COUNT, False),
    ),
    "moved_single": _claim(
        *("Cross-Entropy parameters, single", "table II", PAPER_PARAMETERS["single"], 0, _RATES),
        *(COUNT, False),
    ),
    "fitted_piecewise": _claim(
        *("fitted parameters, piecewise", "table II", PAPER_PARAMETERS["piecewise"], 0, _PIECES),
        *(COUNT, False),
    ),
    "fitted_single": _claim(
        *("fitted parameters, single", "table II", PAPER_PARAMETERS["single"], 0, _LAWS, COUNT, False),
    ),
    "identified": Claim("lane changes identified", "section II", 403581, 0, "", COUNT),
    "closing": _claim(
        *("lane changes with negative range rate", "section II", 173692, 0),
        "the published records hold fewer of them, and the paper does not state the rest of its selection",
        COUNT,
    ),
}
STATEMENTS = {
    "independent": _claim(
        *("in a segment the variables are independent: Kendall's tau of the pair that depends most",),
        *("section II", 0, 0, "they depend on each other; chapter 5 tests all pairs", STATED),
    ),
    "pareto": _claim(
        *("Pareto describes R^-1 best among common families: its rank by AIC", "section II", 1, 0),
        *("the paper does not name its criterion", STATED),
    ),
    "exponential": _claim(
        *("exponential describes TTC^-1 best: its best rank in a segment by AIC", "section II", 1, 0),
        *("the paper does not name its criterion", STATED),
    ),
    "similar": _claim(
        *("the segments are similar in distribution: largest / smallest 95 % quantile of TTC^-1",),
        *("section VI.A", 1, 0, "the faster the traffic, the gentler the cut-ins", STATED),
    ),
    "same_tail": _claim(
        *("three pieces of R^-1 have the same tail as two: ratio of the rates of the last pieces",),
        *("section VI.A", 1, 0, "the last pieces begin at different knots", STATED),
    ),
    "settled_ttc": _claim(
        *("parameters stabilize, TTC^-1: change of the main tilt from update to update, below 5 %",),
        *("section VI.B", 0, 0.05, "the events are few and have unequal weights", STATED),
    ),
    "settled_range": _claim(
        *("parameters stabilize, R^-1: change of the main tilt from update to update, below 5 %",),
        *("section VI.B", 0, 0.05, "the events are few and have unequal weights", STATED),
    ),
    "same_estimate": _claim(
        *("piecewise and single estimate the same probability: ratio of the pooled estimates",),
        *("section VI.C", 1, 0, "", STATED),
    ),
    "faster_search": _claim(
        *(
            "piecewise needs fewer simulations with its search, in the segment with most crashes: single / "
            "piecewise, above 1",
        ),
        *("section VII", 1, 0, "the search of piecewise takes more simulations than it saves", ABOVE),
    ),
    "faster_all": _claim(
        *("the same with searches in all segments, however rare crashes are in them",),
        *("section VII", 1, 0, "most of the searches are in segments that contribute nothing", ABOVE),
    ),
    "half": _claim(
        *("piecewise reduces the evaluation time by almost half: share saved, .4 to .5",),
        *("section VII", 0.45, 0.05, "the paper's own table I gives 36 %", STATED),
    ),
    "faster": _claim(
        *("7000 times faster than crude Monte Carlo, without the search",),
        *("section VII", 7000, 500, "both numbers of simulations differ from the paper's", STATED),
    ),
    "orders": _claim(
        *("almost four orders of magnitude faster: log10 of the ratio, 3.5 to 4",),
        *("abstract", 3.75, 0.25, "both numbers of simulations differ from the paper's", STATED),
    ),
    "heuristic": _claim(
        *("the heuristic improves on piecewise in the first segment: piecewise / heuristic, above 1",),
        *("section VI.C", 1, 0, "it acts only if an iteration has too few events", ABOVE),
    ),
    "shifted": _claim(
        *("the same, if the knots move in every iteration (method shifted): piecewise / shifted, above 1",),
        *("section VI.C", 1, 0, "moving the knots does not help", ABOVE),
    ),
}
CLAIMS = NUMBERS | STATEMENTS
