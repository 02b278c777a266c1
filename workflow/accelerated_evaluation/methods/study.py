"""Run a method for the study: its searches, if it has any, and independent replicates of its estimate."""

import warnings
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
import pandas as pd
from tqdm import trange

from accelerated_evaluation.methods import Method, Stopping
from accelerated_evaluation.methods.cross_entropy.method import CrossEntropyMethod
from accelerated_evaluation.methods.cross_entropy.search import Proposals, Search
from accelerated_evaluation.methods.problem import Problem

ALL = "all"


def study_method(
    method: Method,
    problem: Problem,
    stopping: Stopping,
    generators: Sequence[np.random.Generator],
    labels: Mapping[str, str],
    proposals: Sequence[Proposals] = (),
) -> dict[str, pd.DataFrame]:
    """Estimate the probability of the event in independent replicates, one for each generator.

    The tables are ``estimates``, with one row for each replicate, and those of `Method.tables`; ``labels``
    are columns that identify the estimates. With separate searches of a method, replicate k uses result k
    modulo their number.
    """
    rows: list[dict[str, Any]] = []
    tables: dict[str, list[pd.DataFrame]] = {name: [] for name in method.tables}
    for replicate, generator in zip(
        trange(len(generators), desc=", ".join(labels.values())), generators, strict=True
    ):
        learnt = (proposals[replicate % len(proposals)],) if method.learns_apart else ()
        estimate = method.estimate(problem, stopping, generator, *learnt)
        numbered = {**labels, "replicate": replicate}
        rows.append(numbered | estimate.row())
        for name, parts in tables.items():
            part = estimate.tables[name]
            parts.append(part.assign(**numbered)[[*numbered, *part.columns]])
    joined = {name: pd.concat(parts, ignore_index=True) for name, parts in tables.items()}
    return {"estimates": pd.DataFrame(rows)} | joined


def with_encounters(runs: pd.DataFrame, problem: Problem) -> pd.DataFrame:
    """Rename the normal scores of simulations by the coordinates of the law, and add these coordinates.

    For a cut-in, the scores are called ``z_lead_speed``, ``z_range`` and ``z_closing_speed``, and the new
    columns are ``lead_speed`` [m/s], ``range`` [m], ``closing_speed`` [m/s] and, under a law with strata,
    ``segment``. For other scenarios, the names are those of their variables.
    """
    scores = [f"z_{k + 1}" for k in range(problem.dimension)]
    z = runs[scores].to_numpy()
    coordinates = problem.coordinates(z)
    renamed = runs.rename(columns={z: f"z_{name}" for z, name in zip(scores, coordinates, strict=True)})
    if not problem.known_law.strata:
        return renamed.assign(**coordinates)
    names = np.array([*problem.stratified.shares])[problem.stratified.stratum_of_normal_scores(z)]
    return renamed.assign(**coordinates, segment=names)


def in_scope(
    problem: Problem, proposals: Sequence[Proposals], scope: str
) -> tuple[Problem, Sequence[Proposals]]:
    """Return a problem and its proposals, restricted to one stratum; ``all`` leaves them unchanged."""
    if scope == ALL:
        return problem, proposals
    return problem.only(scope), [found.only(scope) for found in proposals]


def search_strata(
    method: CrossEntropyMethod, problem: Problem, generator_of: Callable[[str], np.random.Generator]
) -> tuple[Proposals, pd.DataFrame]:
    """Search for the accelerated distribution f* of every stratum by the Cross-Entropy method.

    A search that does not reach the event gives a warning. The second result is the trace, every iteration of
    every search.
    """
    searches = {}
    for stratum in problem.stratified.strata:
        searches[stratum] = _searched(method, problem, stratum, generator_of(stratum))
        if searches[stratum].unfinished:
            warnings.warn(f"{method.name}, segment {stratum}: {searches[stratum].unfinished}", stacklevel=2)
    traces = [pd.DataFrame(search.trace) for search in searches.values()]
    for stratum, trace in zip(searches, traces, strict=True):
        trace.insert(0, "segment", stratum)
    return Proposals.of(searches), pd.concat(traces, ignore_index=True)


def _searched(
    method: CrossEntropyMethod, problem: Problem, stratum: str, generator: np.random.Generator
) -> Search:
    with trange(0, desc=f"{method.name}, {stratum} m/s", unit=" iterations") as progress:
        return method.search(problem, stratum, generator, lambda _: progress.update())
