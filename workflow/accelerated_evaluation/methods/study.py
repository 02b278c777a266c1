"""The study of one method: independent replicates, each an estimate and the tables that come with it."""

import warnings
from collections.abc import Callable, Mapping, Sequence

import numpy as np
import pandas as pd
from tqdm import trange

from accelerated_evaluation.methods.cross_entropy.proposals import Proposals
from accelerated_evaluation.methods.estimate import Method, Stopping
from accelerated_evaluation.problem import Problem

ALL = "all"


def study_method(
    method: Method,
    problem: Problem,
    stopping: Stopping,
    generators: Sequence[np.random.Generator],
    labels: Mapping[str, str],
    proposals: Sequence[Proposals] = (),
) -> dict[str, pd.DataFrame]:
    """Estimate the probability of the event in independent replicates.

    Parameters
    ----------
    method
        The method with its settings.
    problem
        The law, the vehicle and the event.
    stopping
        When an estimate is good enough.
    generators
        Source of all randomness of each replicate.
    labels
        Columns that say what was estimated, such as the study, the scope and the method.
    proposals
        What the searches of a method that learns apart have found; the replicates take them in turn.

    Returns
    -------
    dict
        ``estimates``, one row a replicate, and each table of the method, the replicates one after the other.
    """
    rows, tables = [], {name: [] for name in method.tables}
    for replicate, generator in zip(
        trange(len(generators), desc=", ".join(labels.values())), generators, strict=True
    ):
        learnt = (proposals[replicate % len(proposals)],) if method.learns_apart else ()
        estimate = method.estimate(problem, stopping, generator, *learnt)
        numbered = {**labels, "replicate": replicate}
        rows.append(numbered | estimate.row())
        for name, parts in tables.items():
            part = estimate.tables[name] if name != "runs" else with_cut_ins(estimate.tables[name], problem)
            parts.append(part.assign(**numbered)[[*numbered, *part.columns]])
    joined = {name: pd.concat(parts, ignore_index=True) for name, parts in tables.items()}
    return {"estimates": pd.DataFrame(rows)} | joined


def with_cut_ins(runs: pd.DataFrame, problem: Problem) -> pd.DataFrame:
    """Name the normal scores of simulations by their variables, and add the cut-ins that they stand for.

    Parameters
    ----------
    runs
        One row a simulation, with the normal scores ``z_1``, ``z_2`` and ``z_3``.
    problem
        The law maps the scores to cut-ins.

    Returns
    -------
    pandas.DataFrame
        The scores are called ``z_lead_speed``, ``z_inverse_range`` and ``z_inverse_ttc``; new are
        ``lead_speed`` [m/s], ``inverse_range`` [1/m], ``inverse_ttc`` [1/s] and ``segment``.
    """
    scores = [f"z_{k}" for k in (1, 2, 3)]
    z = runs[scores].to_numpy()
    cut_ins = vars(problem.law.from_normal_scores(z))
    names = np.array([*problem.law.shares])[problem.law.stratum_of_normal_scores(z)]
    renamed = runs.rename(columns={z: f"z_{name}" for z, name in zip(scores, cut_ins, strict=True)})
    return renamed.assign(**cut_ins, segment=names)


def in_scope(
    problem: Problem, proposals: Sequence[Proposals], scope: str
) -> tuple[Problem, Sequence[Proposals]]:
    """Return a problem and what was found for it in one stratum, or both as they are for ``all``."""
    if scope == ALL:
        return problem, proposals
    return problem.only(scope), [found.only(scope) for found in proposals]


def search_strata(
    method: Method, problem: Problem, generator_of: Callable[[str], np.random.Generator]
) -> tuple[Proposals, pd.DataFrame]:
    """Let a method that learns apart search f* of every stratum.

    Parameters
    ----------
    method
        One of the methods that search by Cross-Entropy.
    problem
        The law, the vehicle and the event.
    generator_of
        Gives the source of all randomness of one stratum.

    Returns
    -------
    proposals : Proposals
        f* of each stratum.
    trace : pandas.DataFrame
        Every iteration of every search, with the column ``segment`` in front.
    """
    searches = {}
    for stratum in problem.law.strata:
        with trange(0, desc=f"{method.name}, {stratum} m/s", unit=" iterations") as progress:
            searches[stratum] = method.search(
                problem, stratum, generator_of(stratum), lambda _, bar=progress: bar.update()
            )
        if searches[stratum].unfinished:
            warnings.warn(f"{method.name}, segment {stratum}: {searches[stratum].unfinished}", stacklevel=2)
    traces = [pd.DataFrame(search.trace) for search in searches.values()]
    for stratum, trace in zip(searches, traces, strict=True):
        trace.insert(0, "segment", stratum)
    return Proposals.of(searches), pd.concat(traces, ignore_index=True)
