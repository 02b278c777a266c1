"""The section ``models`` of the configuration, which describes the paper's laws."""

from accelerated_evaluation.base.sections import (
    SHARE,
    Schema,
    choice,
    integer,
    listed,
    number,
    section,
    share,
    text,
)
from accelerated_evaluation.laws.paper.models import PIECEWISE


def models_section() -> Schema:
    """Return the section of the paper's laws: the cap, and for each variable its pieces and knots."""
    return section(
        closing_speed_max=number(
            23.49,
            0,
            100,
            "Cap on the closing speed in the paper's laws [m/s]; larger closing speeds are replaced by it.",
            exclusive=True,
            auto=True,
        ),
        inverse_range=section(
            pieces=text(
                "bounded exponential", "Kind of distribution of every piece of R^-1 (section VI.A.1)."
            ),
            variant=choice(
                "two_pieces",
                [*PIECEWISE],
                "Model of R^-1 under which cut-ins are simulated; both models are fitted (section VI.A.1).",
            ),
            two_pieces=_knots("profile", [0.8], "Knot gamma_1 of R^-1 [1/m]", (95, 0.05, 0.99)),
            three_pieces=_knots(
                "profile", [0.7, 0.9], "Knots gamma_1, gamma_2 of R^-1 [1/m], increasing,", (95, 0.05, 0.99)
            ),
        ),
        inverse_ttc=section(
            body=section(
                kind=text(
                    "bounded normal", "Kind of distribution of TTC^-1 below its knot (section VI.A.1)."
                ),
                components=integer(2, 1, 5, "Number of mixture components of that kind (section VI.A.1)."),
            ),
            tail=text(
                "bounded exponential", "Kind of distribution of TTC^-1 above its knot (section VI.A.1)."
            ),
            knots=_knots(
                "quantiles",
                [0.95],
                "Knot gamma_1 of TTC^-1 [1/s], the same in all segments,",
                (40, 0.5, 0.995),
            ),
        ),
    )


def _knots(method: str, quantiles: list[float], value: str, grid: tuple[int, float, float]) -> Schema:
    """Return the section of the knots of a law; arguments are the defaults, and the words for values."""
    several = len(quantiles) > 1
    return section(
        method=choice(
            method,
            ["quantiles", "values", "profile"],
            "Method by which the knots are chosen (section III.A). The settings are in the key of the same "
            "name, and the other two keys are not used.",
        ),
        quantiles=listed(
            quantiles,
            SHARE,
            "Sample quantiles for the knots, increasing, for method quantiles."
            if several
            else "Sample quantile for the knot, for method quantiles.",
            fewest=len(quantiles),
            maxItems=len(quantiles),
        ),
        values=listed(
            None,
            {"type": "number", "exclusiveMinimum": 0, "maximum": 100},
            f"{value} for method values.",
            fewest=len(quantiles),
            type=["array", "null"],
            maxItems=len(quantiles),
        ),
        profile=section(
            points=integer(
                grid[0],
                2,
                1000,
                "Number of sample quantiles in the grid of possible knots, of which method profile chooses "
                "those with the largest likelihood.",
            ),
            low=share(grid[1], "First quantile of that grid."),
            high=share(grid[2], "Last quantile of that grid."),
        ),
    )
