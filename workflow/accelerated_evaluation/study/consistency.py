"""Conditions on the configuration that a schema cannot express: between several keys, or on names."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import combinations, pairwise
from typing import Any

from accelerated_evaluation.base.sections import Check
from accelerated_evaluation.laws.paper.models import PIECEWISE
from accelerated_evaluation.laws.paper.piecewise import mixture_kinds, piece_kinds
from accelerated_evaluation.records.sources import SOURCES
from accelerated_evaluation.study.preflight import UNDER_TEST, compared_sections
from accelerated_evaluation.study.schema import schema

COMPARED = {"crude", "heuristic", "piecewise", "shifted", "single", "surrogate"}
FOLDERS = {"benchmarks", "vehicles"}  # folders of results/ that do not belong to a single study
LONGEST = 64  # longest name of a study; file systems allow 255 bytes, of which temporary files need some
KNOTS = (*(f"models.inverse_range.{name}" for name in PIECEWISE), "models.inverse_ttc.knots")


def _are_methods(names: Sequence[str]) -> bool:
    """Return whether all names are registered methods and include those that the notebooks compare."""
    from accelerated_evaluation.methods import METHODS  # imported here, because it takes a second

    return set(names) >= COMPARED and all(name in METHODS for name in names)


def _is_scenario(name: str) -> bool:
    """Return whether there is a scenario of this name."""
    from accelerated_evaluation.scenarios import SCENARIOS

    return name in SCENARIOS


def _mapped_events() -> Mapping[str, Any]:
    """Return the events of cut-ins that crash maps can have, by name."""
    from accelerated_evaluation.crash_map.section import (
        THRESHOLDS,  # imported here, because it takes a second
    )

    return THRESHOLDS


def _are_events(scenario: str, events: Mapping[str, Sequence[float]]) -> bool:
    """Return whether names are those of events of a scenario, or of those that have defaults."""
    from accelerated_evaluation.scenarios import SCENARIOS

    own = {each.quantity for each in SCENARIOS[scenario].events} if scenario in SCENARIOS else set()
    return {*events} <= own | {*_mapped_events()}


def _mean_what_they_say(scenario: str, compared: Mapping[str, Mapping]) -> bool:
    """Return whether no label is misleading.

    A label must not be ``under_test``. If it is the name of a built-in vehicle of the scenario, the entry has
    to be this vehicle.
    """
    from accelerated_evaluation.scenarios import SCENARIOS

    sections = compared_sections(compared)
    built_in = sections.keys() & set(SCENARIOS[scenario].vehicles) if scenario in SCENARIOS else ()
    return UNDER_TEST not in sections and all(sections[label]["name"] == label for label in built_in)


def _differ(compared: Mapping[str, Mapping]) -> bool:
    """Return whether no two entries are the same vehicle, whose results would be in the same files."""
    return all(one != other for one, other in combinations(compared_sections(compared).values(), 2))


def _rising(values: Sequence[float] | None) -> bool:
    return values is None or all(low < high for low, high in pairwise(values))


def _segments_rise(edges: Sequence[float]) -> bool:
    """Return whether edges rise after rounding as in the names of segments, which must be different."""
    return _rising([float(f"{edge:g}") for edge in edges])


def _enclose(edges: Sequence[float], low: float, high: float) -> bool:
    """Return whether all lead speeds within the filters, [low, high), are between the outer edges."""
    return edges[0] <= low and high <= edges[-1]


def _is_plain_line(text: str) -> bool:
    """Return whether a text is one printable line that a spreadsheet does not interpret as a formula."""
    return text.isprintable() and text == text.strip() and text[0] not in "=+-@"


def _is_own_folder(study: str) -> bool:
    """Return whether the name of a study can be the name of its folder.

    The pattern of the schema does not detect a line break at the end, which is therefore checked here.
    """
    return len(study) <= LONGEST and study.isprintable() and study not in FOLDERS


def _of_sources() -> Iterator[Check]:
    """Yield the conditions on the section of each source; most apply only to the source that is used."""
    yield Check(
        ("data.source",),
        lambda source: source in SOURCES,
        f"a source of records: one of {', '.join(SOURCES)}",
    )
    for name, source in SOURCES.items():
        yield Check(
            (f"data.{name}.description",),
            _is_plain_line,
            "one line of printable characters that begins with none of = + - @ and no space",
        )
        yield Check(
            ("data.sample", "data.source", f"data.{name}.outlier_rows"),
            lambda sample, used, rows, name=name: sample is None or used != name or not rows,
            "no outlier rows with a sample, because they count the rows of the whole table",
        )
        yield Check(
            ("data.source", f"data.{name}.path"),
            lambda used, path, name=name: used != name or path is not None,
            f"a path, as the source is {name}: {source.files}",
        )
        for check in source.checks:
            yield replace(check, keys=tuple(f"data.{name}.{key}" for key in check.keys))


CHECKS = (
    Check(
        ("study",),
        _is_own_folder,
        f"a name of at most {LONGEST} characters, on one line and none of {', '.join(sorted(FOLDERS))}",
    ),
    Check(("scenario.name",), _is_scenario, "cut_in, left_turn, pedestrian or another scenario"),
    Check(
        ("scenario.name", "answer.events"),
        _are_events,
        "thresholds of outcomes by which the scenario defines events",
    ),
    Check(
        ("crash_map.events",),
        lambda events: (
            {*events} <= {*schema()["properties"]["crash_map"]["properties"]["events"]["properties"]}
        ),
        "thresholds of outcomes by which cut-ins define events",
    ),
    Check(
        ("methods",),
        _are_methods,
        f"names of methods, with {', '.join(sorted(COMPARED))} among them",
    ),
    Check(
        ("filters.lead_speed_min", "filters.lead_speed_max"),
        lambda low, high: low < high,
        "lead_speed_min below lead_speed_max",
    ),
    Check(
        ("segments.lead_speed_edges",),
        _segments_rise,
        "edges in increasing order, also after rounding to six digits",
    ),
    Check(
        ("segments.lead_speed_edges", "filters.lead_speed_min", "filters.lead_speed_max"),
        _enclose,
        "edges that begin at or below lead_speed_min and end at or above lead_speed_max",
    ),
    Check(
        ("sensitivity.lead_speed_edges", "filters.lead_speed_min", "filters.lead_speed_max"),
        lambda tried, low, high: all(_segments_rise(edges) and _enclose(edges, low, high) for edges in tried),
        "lists of edges in increasing order, each from lead_speed_min or below to lead_speed_max or above",
    ),
    *(
        check
        for knots in KNOTS
        for check in (
            Check((f"{knots}.quantiles",), _rising, "quantiles in increasing order"),
            Check((f"{knots}.values",), _rising, "knots in increasing order"),
            Check(
                (f"{knots}.method", f"{knots}.values"),
                lambda method, values: method != "values" or values is not None,
                "a list of knots, as the method is values",
            ),
            Check(
                (f"{knots}.profile.low", f"{knots}.profile.high"),
                lambda low, high: low < high,
                "low below high",
            ),
        )
    ),
    *(
        Check(
            (f"models.inverse_range.{variant}.values", "filters.range_max"),
            lambda values, range_max: values is None or min(values) > 1 / range_max,
            "knots above 1 / range_max, where R^-1 begins",
        )
        for variant in PIECEWISE
    ),
    Check(
        ("scenario.name", "compared_vehicles"),
        _mean_what_they_say,
        "labels that are not under_test, and that are the name of a built-in vehicle only where they mean it",
    ),
    Check(("compared_vehicles",), _differ, "vehicles that differ from each other"),
    Check(
        ("models.closing_speed_max", "crash_map.grid.closing_speed_max"),
        lambda cap, top: cap <= top,
        "a map that reaches up to the cap of the laws",
    ),
    Check(
        ("importance_sampling.minimum_events", "importance_sampling.maximum_simulations"),
        lambda events, simulations: events <= simulations,
        "minimum_events not above maximum_simulations",
    ),
    Check(
        ("surrogate.batch_size", "surrogate.maximum_calls"),
        lambda batch, calls: 2 * batch <= calls,
        "a batch of at most half of maximum_calls, because an estimate needs two",
    ),
    Check(
        (
            "importance_sampling.course_step",
            "importance_sampling.simulations",
            "importance_sampling.maximum_simulations",
        ),
        lambda step, *sizes: step <= min(sizes),
        "a step of the course that is not above simulations and maximum_simulations",
    ),
)


def conditions() -> tuple[Check, ...]:
    """Return all conditions; those on registered sources and distributions include the user's own."""
    return (*CHECKS, *_of_sources(), *_of_kinds())


def _of_kinds() -> Iterator[Check]:
    """Yield the conditions on names of distributions."""
    for key in ("models.inverse_range.pieces", "models.inverse_ttc.body.kind", "models.inverse_ttc.tail"):
        yield Check(
            (key,),
            lambda kind: kind in piece_kinds(),
            f"a distribution that can be fitted to a piece and tilted: one of {', '.join(piece_kinds())}",
        )
    yield Check(
        ("models.inverse_ttc.body.kind", "models.inverse_ttc.body.components"),
        lambda kind, components: components == 1 or kind not in piece_kinds() or kind in mixture_kinds(),
        f"one component, or a distribution of which mixtures can be fitted: {', '.join(mixture_kinds())}",
    )
