"""The answer for a slow vehicle, from few simulations chosen by the surrogate-guided sampler."""

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pandas as pd
from fewruns.predecessor import Predecessor
from tqdm import tqdm

from accelerated_evaluation.answer.averaged import SHARE, AveragedSurrogate, posterior_of
from accelerated_evaluation.answer.chosen_law import ANSWER, choose_sampled_law, require_law
from accelerated_evaluation.answer.evidence import Evidence, evidence_on, known_runs, largest, replays_of
from accelerated_evaluation.answer.exposure import exposure_table
from accelerated_evaluation.answer.extrapolation import extrapolation_table, parts_by_speed, reweighted
from accelerated_evaluation.answer.likeliest_crashes import PLACE
from accelerated_evaluation.answer.posterior import Posterior
from accelerated_evaluation.answer.reweighting import LEVEL, SampledPosterior
from accelerated_evaluation.answer.study import event_name
from accelerated_evaluation.base.arrays import Array
from accelerated_evaluation.base.errors import InputError
from accelerated_evaluation.base.randomness import child_generator
from accelerated_evaluation.laws import Law
from accelerated_evaluation.laws.protocol import CutIns
from accelerated_evaluation.laws.smooth.family import DistinctRecords
from accelerated_evaluation.laws.smooth.mean import MeanLaw
from accelerated_evaluation.laws.smooth.support import Support
from accelerated_evaluation.methods import METHODS, Estimate
from accelerated_evaluation.methods.study import ALL, study_method
from accelerated_evaluation.methods.surrogate import Surrogate, read_predecessor
from accelerated_evaluation.problem import Problem
from accelerated_evaluation.records.checks import Records
from accelerated_evaluation.records.filters import Account
from accelerated_evaluation.records.ingest import ingest
from accelerated_evaluation.records.segments import require_rows
from accelerated_evaluation.records.sources import read_source
from accelerated_evaluation.records.verdict import Verdict, verdict_on
from accelerated_evaluation.scenarios.cut_in import CUT_IN
from accelerated_evaluation.scenarios.protocol import Event
from accelerated_evaluation.vehicles.events import CRASH, events_from
from accelerated_evaluation.vehicles.external.slow import SlowVehicle, loaded_for
from accelerated_evaluation.vehicles.external.watched import WatchedVehicle

METHOD = "surrogate"
OF_THE_ANSWER = {"answer", "budget", "draws", "crashes"}
RATE_DRAWS = 1000  # number of equally likely values of a probability from which rates are computed


@dataclass(frozen=True)
class Alone:
    """The results of the command ``estimate``: an estimate for one vehicle, without the rest of the study.

    Attributes
    ----------
    tables
        ``estimate``, one row for each replicate, with the ``law``; ``runs``, one row for each simulation;
        ``account`` of the records. Under the paper's law, the first two are equal to the tables of the
        complete study for this method and all segments. If the law is a mean law, there are also ``answer``,
        one row for each replicate and event; ``budget``, ``draws`` and ``crashes`` of the sampled event;
        ``exposure``; and ``extrapolation``. See `averaged.Course.tables`, `exposure.exposure_table` and
        `extrapolation.extrapolation_table`.
    name
        Name of the law.
    law
        The law that was sampled.
    vehicle
        The slow vehicle, which counts its simulations; None if the vehicle is not slow.
    verdict
        Results of the checks of the records.
    encounters
        The encounter table.
    evidence
        What repetitions in another process and replays of records say about the estimate. If they contradict
        it, no estimate counts as converged.
    event
        The event for which the simulations were chosen.
    """

    tables: Mapping[str, pd.DataFrame]
    name: str
    law: Law
    vehicle: SlowVehicle | None
    verdict: Verdict
    encounters: pd.DataFrame
    evidence: Evidence
    event: Event = CRASH


def estimate_alone(
    config: Mapping[str, Any],
    replicates: int = 1,
    law: str = ANSWER,
    predecessor: str | os.PathLike | None = None,
    share: float = SHARE,
    event: Event = CRASH,
    for_draws: Sequence[str] = (),
) -> Alone:
    """Fit laws to the records, and estimate the probability of the event from few simulations.

    Parameters
    ----------
    config
        A complete, valid configuration.
    replicates
        Number of independent replicates; under the paper's law they are the first replicates of the complete
        study.
    law
        ``answer`` for the mean of draws from the posterior of all laws, the name of a single law, or the path
        of a law file.
    predecessor
        Path of the table of simulations (``runs.csv``) of a similar vehicle under the same law.
    share
        Allowed relative increase of the width of the 80 % interval of the answer by the sampling; 0 for the
        paper's stopping rule.
    event
        The event for which the simulations are chosen, by default a crash.
    for_draws
        Options of the command that were given and need a law with draws.

    Returns
    -------
    Alone
        The tables of the estimate, the law, the verdict on the records, and the evidence for or against the
        estimate.

    Raises
    ------
    InputError
        If the records, the law, the predecessor or the vehicle cannot be used, or if the law has no draws and
        ``for_draws`` is not empty. Simulations that were completed before the error are kept in the store.
    """
    require_law(law)
    with loaded_for(config["vehicle"], config["simulations"]) as vehicle:  # first, because it fails fastest
        raw = read_source(config["data"], child_generator(config["seed"], "sample"))
        data = config["data"]
        place = data[data["source"]]["path"]
        verdict = verdict_on(Records.of(raw, config), place, data["accepted_warnings"])
        encounters, account = _ingested(raw, config)
        name, chosen = choose_sampled_law(law, encounters, config)
        if for_draws and not isinstance(chosen, MeanLaw):
            raise InputError(
                for_draws[0],
                seen=f"the law {name}, which has no draws",
                expected="a law with draws, see --help",
                change="Leave the option out, or choose another law.",
            )
        problem = Problem(chosen, vehicle, event)
        known = None if predecessor is None else read_predecessor(predecessor, problem)
        exposure = encounters.attrs["exposure"]
        records = DistinctRecords.of(encounters, Support.configured(config))
        found = simulate_answer(config, problem, Traffic(records, exposure), replicates, known, share)
    tables = found.tables | {"account": account.table()}
    tables["estimate"] = tables["estimate"].assign(law=name)
    tables = verdict.added_to_answers(tables)
    slow = vehicle if isinstance(vehicle, SlowVehicle) else None
    return Alone(tables, name, chosen, slow, verdict, encounters, found.evidence, event)


@dataclass(frozen=True)
class Traffic:
    """The frequency of cut-ins.

    Attributes
    ----------
    records
        The distinct closing cut-ins within the limits.
    exposure
        ``kilometres`` and ``hours`` in which they were recorded; None if unknown.
    """

    records: DistinctRecords
    exposure: Mapping[str, float | None]

    @property
    def cut_ins(self) -> int:
        """Number of the cut-ins."""
        return self.records.size

    @property
    def per_km(self) -> float | None:
        """Cut-ins per kilometre [1/km]; None if the distance is unknown."""
        kilometres = self.exposure["kilometres"]
        return None if kilometres is None else self.records.size / kilometres


@dataclass(frozen=True)
class Simulated:
    """The tables of `Alone` that are computed from the simulations, and the ``evidence`` of `Alone`."""

    tables: dict[str, pd.DataFrame]
    evidence: Evidence


def simulate_answer(
    config: Mapping[str, Any],
    problem: Problem,
    traffic: Traffic,
    replicates: int = 1,
    predecessor: Predecessor | None = None,
    share: float = SHARE,
) -> Simulated:
    """Estimate the probability of an event from few simulations under a law.

    Parameters
    ----------
    config
        Configuration; only ``study``, ``seed``, ``vehicle``, ``importance_sampling``, ``surrogate`` and
        ``answer`` are read.
    problem
        The law, the vehicle and the event.
    traffic
        Frequency of cut-ins.
    replicates, predecessor, share
        Number of independent replicates; runs of a similar vehicle that guide the sampler; and the allowed
        relative increase of the width of the 80 % interval by the sampling.

    Returns
    -------
    Simulated
        The tables ``estimate``, ``runs``, ``replays`` and, for a mean law, those of the answer; and the
        evidence for or against the estimate.
    """
    law, watched = problem.law, WatchedVehicle(problem.vehicle, CUT_IN)
    problem = replace(problem, vehicle=watched)
    generator = child_generator(config["seed"], "replays")
    replays = replays_of(watched, traffic.records.encounters, problem.event, generator)
    predecessor = predecessor or known_runs(replays, lambda z: law.from_normal_scores(z).encounters)
    with tqdm(desc="simulations", unit="", disable=None) as bar:
        method = _method(config, law, traffic.per_km, share, bar)
        tables = study_method(
            replace(method, predecessor=predecessor),
            problem,
            method.stopping(config),
            [child_generator(config["seed"], *method.stream(ALL, k)) for k in range(replicates)],
            {"study": config["study"], "scope": ALL, "method": METHOD},
        )
    tables["estimate"] = tables.pop("estimates")
    ends = tables["estimate"]["ci_high"]
    if "answer" in tables:
        answers = tables["answer"]
        ends = answers.loc[answers["event"] == event_name(problem.event), "high95"]
    evidence = evidence_on(watched, replays, problem.event, largest(ends))
    tables = evidence.added_to(tables)
    for name in OF_THE_ANSWER & tables.keys():  # these tables do not belong to a method or scope
        tables[name] = tables[name].drop(columns=["scope", "method"], errors="ignore")
    if "draws" in tables:
        tables["exposure"] = _exposure(tables["draws"], traffic, event_name(problem.event))
        tables["extrapolation"] = _extrapolation(tables, law, traffic.records.encounters.T)
    return Simulated(tables, evidence)


def _method(
    config: Mapping[str, Any],
    law: Law,
    cut_ins_per_km: float | None,
    share: float,
    bar: tqdm,
) -> Surrogate:
    """Return the method: `AveragedSurrogate` for a mean law, and `Surrogate` for any other law."""
    if not isinstance(law, MeanLaw):
        method = METHODS[METHOD].configured(config)
        return replace(method, on_batch=lambda estimate: _show(bar, estimate))
    return replace(
        AveragedSurrogate.configured(config),
        events=tuple(events_from(config["answer"]["events"])[1:]),
        cut_ins_per_km=cut_ins_per_km,
        share=share,
        on_answer=lambda estimate, posterior: _show(bar, estimate, posterior),
    )


def _exposure(draws: pd.DataFrame, traffic: Traffic, event: str) -> pd.DataFrame:
    """Return the table of rates of the event, by replicate; see `exposure.exposure_table`."""
    parts = []
    for replicate, of_replicate in draws.groupby("replicate"):
        values = posterior_of(of_replicate).whole.probabilities
        levels = (np.arange(RATE_DRAWS) + 0.5) / RATE_DRAWS
        crash = Posterior(np.quantile(values, levels), np.zeros(RATE_DRAWS, int))
        table = exposure_table({event: crash}, traffic.records.size, traffic.exposure)
        parts.append(table.assign(replicate=replicate))
    return pd.concat(parts or [exposure_table({}, traffic.records.size, traffic.exposure)], ignore_index=True)


def _extrapolation(tables: Mapping[str, pd.DataFrame], law: MeanLaw, records: Array) -> pd.DataFrame:
    """Divide the probability among the runs with the event, by their distance from the records, (n, 3)."""
    parts = []
    for replicate, crashes in tables["crashes"].groupby("replicate"):
        draws, cut_ins = tables["draws"], crashes[list(PLACE)].to_numpy(float)
        probabilities = draws.loc[draws["replicate"] == replicate, "probability"].to_numpy(float)
        lead_speed, range_, closing_speed = cut_ins.T
        log_ratios = law.log_ratios(CutIns(lead_speed, 1 / range_, closing_speed / range_))
        weights = reweighted(log_ratios, crashes["share"].to_numpy(float), probabilities)
        table = extrapolation_table(parts_by_speed(records, cut_ins), weights, len(records))
        parts.append(table.assign(replicate=replicate))
    return pd.concat(parts, ignore_index=True) if parts else pd.DataFrame(columns=["part", "replicate"])


def read_records(config: Mapping[str, Any]) -> tuple[pd.DataFrame, Account]:
    """Read and filter the records of a configuration.

    Parameters
    ----------
    config
        A complete, valid configuration, which names the source of the records and the filters.

    Returns
    -------
    encounters : pandas.DataFrame
        The encounter table, with one row for each record that passes the filters. Its ``attrs["exposure"]``
        contains the kilometres and hours in which the records were made; None if they are not known.
    account : Account
        How many rows each filter has removed.
    """
    return _ingested(read_source(config["data"], child_generator(config["seed"], "sample")), config)


def _ingested(raw: pd.DataFrame, config: Mapping[str, Any]) -> tuple[pd.DataFrame, Account]:
    account = Account.of(raw)
    encounters = ingest(raw, config, account)
    encounters.attrs["exposure"] = raw.attrs["exposure"]
    require_rows(encounters)
    return encounters, account


def _show(bar: tqdm, estimate: Estimate, posterior: SampledPosterior | None = None) -> None:
    """Show the progress of an estimate: the interval of the answer, and that of the sampling alone."""
    bar.n = estimate.simulations
    text = f"{estimate.events} events, sampling alone {estimate.low:.2g} to {estimate.high:.2g}"
    if posterior is not None:
        low, high = posterior.whole.interval(LEVEL)
        text = f"{low:.2g} to {high:.2g} with laws and data, {text}"
    bar.set_postfix_str(text)
