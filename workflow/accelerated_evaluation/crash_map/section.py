"""The section ``crash_map`` of the configuration, and its parts, which other sections use as well."""

from accelerated_evaluation.base.sections import Schema, integer, listed, number, section

THRESHOLDS = {  # events that are mapped in addition to the crash: largest threshold, unit, and words
    "impact_speed": (100, "the impact speed [m/s]; the crashes above each of them are mapped."),
    "min_range": (1000, "the smallest range [m]; the encounters at or below each of them are mapped."),
    "min_ttc": (1000, "the smallest TTC [s]; the encounters at or below each of them are mapped."),
}
SIDES = ("lead_speed_cells", "range_cells", "refinement", "closing_speed_points")


def grid_section(closing_speed_max: float, *sides: int) -> Schema:
    """Return the section of the configuration for the grid of crash maps, with its defaults."""
    default = dict(zip(SIDES, sides, strict=True))
    return section(
        closing_speed_max=number(
            closing_speed_max,
            0,
            100,
            "Largest closing speed that is scanned [m/s]. Above it, an event is assumed to happen if it "
            "happens at this speed.",
            exclusive=True,
            auto=True,
        ),
        lead_speed_cells=integer(
            default["lead_speed_cells"], 4, 10_000, "Number of cells of v_L before the map is refined."
        ),
        range_cells=integer(
            default["range_cells"],
            4,
            10_000,
            "Number of cells of the square root of the range before the map is refined.",
        ),
        refinement=integer(
            default["refinement"],
            1,
            1000,
            "Largest number of parts into which the sides of cells are divided where outcomes differ.",
        ),
        closing_speed_points=integer(
            default["closing_speed_points"],
            10,
            100_000,
            "Number of closing speeds that are simulated on each line of the map before bisection.",
        ),
    )


def events_section(**thresholds: list[float]) -> Schema:
    """Return the section of the configuration for the thresholds of events, with its defaults.

    Further keys are names of events of other scenarios, which `study.consistency` checks.
    """
    events = section(
        **{
            name: listed(
                thresholds[name],
                {"type": "number", ("minimum" if name == "impact_speed" else "exclusiveMinimum"): 0}
                | {"maximum": largest},
                f"Thresholds of {words}",
            )
            for name, (largest, words) in THRESHOLDS.items()
        }
    )
    other = {
        "type": "array",
        "minItems": 1,
        "items": {"type": "number", "minimum": 0, "maximum": 1_000_000},
        "description": "Thresholds of another event of the scenario.",
    }
    return {**events, "additionalProperties": other}


def crash_map_section() -> Schema:
    """Return the section of the crash maps of the paper's methods."""
    return section(
        grid=grid_section(23.49, 60, 100, 16, 240),
        events=events_section(
            impact_speed=[0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 12, 15, 20],
            min_range=[0.5, 1, 2],
            min_ttc=[0.5, 1, 1.5],
        ),
    )
