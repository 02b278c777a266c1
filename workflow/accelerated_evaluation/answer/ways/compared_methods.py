"""Estimates of one event by methods that only need normal scores, and by a scan if there is one."""

from collections.abc import Callable, Mapping, Sequence

import numpy as np
import pandas as pd

from accelerated_evaluation.answer.ways.by_scan import exact_probability
from accelerated_evaluation.base.sections import Sections
from accelerated_evaluation.laws import Law
from accelerated_evaluation.methods import METHODS
from accelerated_evaluation.methods.problem import Problem
from accelerated_evaluation.methods.study import study_method
from accelerated_evaluation.scenarios.events import Event
from accelerated_evaluation.scenarios.protocol import Scenario
from accelerated_evaluation.vehicles.protocol import Vehicle

METHODS_OF_SCORES = ("crude", "normal_mixture", "surrogate")  # methods that only need normal scores


def compare_methods(
    scenario: Scenario,
    laws: Mapping[str, Law],
    vehicle: Vehicle,
    event: Event,
    methods: Sequence[str],
    sections: Sections,
    stream: Callable[..., np.random.Generator],
    labels: Mapping[str, str],
) -> pd.DataFrame:
    """Estimate the probability of an event under single laws by several methods.

    The methods are given by their names. ``sections`` has their sections of the configuration, ``stream``
    returns the generator of a step by its name, and ``labels`` are columns that name the study. The table has
    a row for each law, method and replicate. Its columns ``exact`` and ``exact_error`` have the probability
    from a scan and its relative standard error, NaN if the scenario has no scans.
    """
    parts: list[pd.DataFrame] = []
    for law_name, law in laws.items():
        problem = Problem(scenario, vehicle, event, law=law)
        known = exact_probability(problem, stream("exact", law_name))
        for name in methods:
            method = METHODS[name].configured(sections)
            count = method.replicates(sections) or 1
            generators = [stream(name, law_name, replicate) for replicate in range(count)]
            named = {**labels, "law": law_name, "method": name}
            made = study_method(method, problem, method.stopping(sections), generators, named)
            parts.append(made["estimates"].assign(exact=known[0], exact_error=known[1]))
    return pd.concat(parts, ignore_index=True).assign(event=scenario.event_in_words(event))
