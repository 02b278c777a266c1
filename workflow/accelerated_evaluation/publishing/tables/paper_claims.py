"""The numbers that the paper states, their precision, and reasons why ours may differ."""

from dataclasses import dataclass

from accelerated_evaluation.publishing.tables.paper_numbers import (
    PAPER_PARAMETERS,
    PAPER_PROBABILITY,
    PAPER_RATIOS,
    PAPER_SEARCHES,
    PAPER_SIMULATIONS,
)

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
    """A number that the paper states.

    Attributes
    ----------
    claim, source
        What the number means, and where in the paper it is stated.
    paper, tolerance
        The number, and its tolerance: half a unit of the last printed digit, or half the width of an
        interval.
    reason
        Reason why our number may differ.
    rests_on_study
        Whether the number depends on the data, the vehicle and the settings.
    """

    claim: str
    source: str
    paper: float
    tolerance: float
    reason: str
    rests_on_study: bool = True


CLAIMS = {
    "probability": Claim(
        "crash probability of one lane change", "section VI.C", PAPER_PROBABILITY, 0.4e-7, _KNOTS
    ),
    "probability_low": Claim("80 % interval of it, lower end", "section VI.C", 7.0e-7, 0.05e-7, _INTERVAL),
    "probability_high": Claim("80 % interval of it, upper end", "section VI.C", 7.8e-7, 0.05e-7, _INTERVAL),
    "piecewise": Claim(
        "simulations to converge, piecewise, mean", "table I", PAPER_SIMULATIONS["piecewise"], 0.5, _SEARCH
    ),
    "single": Claim(
        "simulations to converge, single, mean", "table I", PAPER_SIMULATIONS["single"], 0.5, _SEARCH
    ),
    "crude": Claim(
        "simulations to converge, crude Monte Carlo",
        "table I",
        PAPER_SIMULATIONS["crude"],
        0.05e7,
        "it is inverse to the crash probability, see there",
    ),
    "ratio_single": Claim("single / piecewise", "table I", PAPER_RATIOS["single"], 0.005, _COUNTS),
    "ratio_crude": Claim("crude / piecewise", "table I, section VII", PAPER_RATIOS["crude"], 0.5e3, _COUNTS),
    "piecewise_run": Claim("simulations to converge, piecewise, one run", "section VI.C", 7800, 50, _SEARCH),
    "single_run": Claim("simulations to converge, single, one run", "section VI.C", 13800, 50, _SEARCH),
    "saving_run": Claim("share saved by piecewise, one run", "section VI.C", 0.44, 0.005, _COUNTS),
    "saving": Claim(
        "share saved by piecewise, mean",
        "section VII",
        0.33,
        0.005,
        "the paper's own table I gives 36 %",
    ),
    "search_piecewise": Claim(
        "Cross-Entropy simulations, piecewise",
        "table II",
        PAPER_SEARCHES["piecewise"],
        500,
        _ADAPTIVE.format(8),
    ),
    "search_single": Claim(
        "Cross-Entropy simulations, single", "table II", PAPER_SEARCHES["single"], 500, _ADAPTIVE.format(10)
    ),
    "moved_piecewise": Claim(
        "Cross-Entropy parameters, piecewise", "table II", PAPER_PARAMETERS["piecewise"], 0, _PIECES, False
    ),
    "moved_single": Claim(
        "Cross-Entropy parameters, single", "table II", PAPER_PARAMETERS["single"], 0, _RATES, False
    ),
    "fitted_piecewise": Claim(
        "fitted parameters, piecewise", "table II", PAPER_PARAMETERS["piecewise"], 0, _PIECES, False
    ),
    "fitted_single": Claim(
        "fitted parameters, single", "table II", PAPER_PARAMETERS["single"], 0, _LAWS, False
    ),
    "identified": Claim("lane changes identified", "section II", 403581, 0, ""),
    "closing": Claim(
        "lane changes with negative range rate",
        "section II",
        173692,
        0,
        "the published records hold fewer of them, and the paper does not state the rest of its selection",
    ),
}
