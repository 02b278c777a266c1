"""The estimate for one vehicle in a scenario other than the cut-in, from about 150 simulations."""

import os
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd

from accelerated_evaluation.answer.averaged import answer_in_words, budget_in_words
from accelerated_evaluation.answer.chosen_law import ANSWER
from accelerated_evaluation.answer.evidence import Evidence, evidence_on, largest, replays_of
from accelerated_evaluation.answer.joint.scores import Candidate
from accelerated_evaluation.answer.scenario import ScenarioStudy, clustered_records
from accelerated_evaluation.answer.scenario_methods import METHODS_OF_SCORES, compare_methods
from accelerated_evaluation.base.errors import InputError
from accelerated_evaluation.base.randomness import child_generator
from accelerated_evaluation.laws.joint import JOINT_LAWS, JointLaw
from accelerated_evaluation.laws.joint.files import read_verdict
from accelerated_evaluation.problem import read_scenario_law
from accelerated_evaluation.records.verdict import Verdict, verdict_on
from accelerated_evaluation.scenarios import SCENARIOS
from accelerated_evaluation.scenarios.protocol import FITTED, Scenario
from accelerated_evaluation.scenarios.record_table import configured_records, read_scenario_records
from accelerated_evaluation.vehicles.events import event_named
from accelerated_evaluation.vehicles.external.slow import loaded_for
from accelerated_evaluation.vehicles.external.watched import WatchedVehicle
from accelerated_evaluation.vehicles.loading import load_vehicle


@dataclass(frozen=True)
class ScenarioEstimate:
    """The estimate for one vehicle in a scenario.

    Attributes
    ----------
    tables
        Tables by name: ``laws``, ``answer``, ``budget`` and ``draws`` if all laws were used; ``estimate`` and
        ``runs`` if one law was used.
    law
        The law with the largest weight, or the single law that was used.
    not_ended
        Number of simulations that were stopped at their time limit.
    event
        The event in words.
    verdict
        The verdict on the records.
    evidence
        What repetitions in another process and replays of records say about the estimate.
    """

    tables: Mapping[str, pd.DataFrame]
    law: JointLaw
    not_ended: int
    event: str
    verdict: Verdict
    evidence: Evidence

    def lines(self) -> list[str]:
        """Return the lines of text that describe the estimate."""
        doubts = [f"warning: {doubt}" for doubt in self.evidence.doubts]
        lines = [*self.verdict.lines(), *doubts, *self._estimates(), self.evidence.in_words]
        if not self.not_ended:
            return lines
        runs = f"{self.not_ended:,} {'run' if self.not_ended == 1 else 'runs'}"
        return [*lines, f"warning: {runs} did not end, and count as runs without the event"]

    def _estimates(self) -> list[str]:
        if "answer" in self.tables:
            row = self.tables["answer"].iloc[0].to_dict()
            runs = f"simulated: {row['simulations']:,} encounters"
            if row["unseen_lapses"]:
                runs += (
                    f"; not converged, because lapses that no run has shown can add up to "
                    f"{row['unseen_lapses']:.1g}, which the upper ends contain"
                )
            elif not row["converged"]:
                runs += "; not converged, so that parts of the event may be missing"
            words = answer_in_words(row | {"per_km": np.nan}, "an encounter")
            return [*words, *budget_in_words(self.tables["budget"]), runs]
        return [
            f"{self.event}: probability {row.probability:.3g} under this law, interval of the sampling alone "
            f"{row.ci_low:.2g} to {row.ci_high:.2g}; {'' if row.converged else 'not '}converged after "
            f"{row.learning + row.estimating:,} encounters, {row.events:,} of them with the event"
            for row in self.tables["estimate"].itertuples()
        ]


def estimate_scenario(
    config: Mapping[str, Any],
    law: str = ANSWER,
    replicates: int = 1,
    method: str = "surrogate",
    predecessor: str | os.PathLike | None = None,
) -> ScenarioEstimate:
    """Estimate the probability of the event of a configuration for its vehicle in its scenario.

    Parameters
    ----------
    config
        A complete, valid configuration.
    law
        ``answer`` for all joint laws with their weights, which includes the uncertainty in the law and its
        parameters; the name of a kind of joint law, which is fitted to the records; or the path of the file
        of a joint law.
    replicates
        Number of independent replicates, if one law is used.
    method
        Name of the method, if one law is used.
    predecessor
        Path of the table of the runs of a similar vehicle under the same law, for the method ``surrogate``.

    Raises
    ------
    InputError
        If the records, the law, the method, the event or the vehicle cannot be used, if a check of the
        records has the verdict ``stop`` and is not accepted, or if no run ended in the event.
    """
    if method not in METHODS_OF_SCORES:
        raise InputError(
            "--method",
            seen=f"{method!r}, which does not exist or needs a law of cut-ins",
            expected=f"one of {', '.join(METHODS_OF_SCORES)}",
            change="Name one of these.",
        )
    if predecessor is not None and (law == ANSWER or method != "surrogate"):
        raise InputError(
            "--predecessor",
            seen=f"the law {law} and the method {method}",
            expected="one law, and the method surrogate",
            change="Name the law.json of the predecessor's estimate by --law, or leave --predecessor out.",
        )
    scenario, seed = SCENARIOS[config["scenario"]["name"]], config["seed"]
    event = event_named(config["scenario"]["event"], scenario, where="scenario.event")
    named = scenario.event_in_words(event)
    verdict = verdict_on_law(scenario, law, config)
    records = read_scenario_records(scenario, config["scenario"]["records"])
    with loaded_for(config["vehicle"], config["simulations"], scenario) as loaded:
        vehicle = WatchedVehicle(loaded, scenario)
        x = scenario.as_in_law(records.loc[records[FITTED], list(scenario.names)].to_numpy(float)).T
        replays = replays_of(vehicle, x, event, child_generator(seed, "replays"))
        if law == ANSWER:
            known = load_vehicle(scenario.default_vehicle, scenario)
            study = ScenarioStudy.of(scenario, records, known, seed, config["scenario"]["draws"])
            tables = study.answer_by_few_runs(vehicle, seed, event, replays)
            evidence = evidence_on(vehicle, replays, event, largest(tables["answer"]["high95"]))
            tables = verdict.added_to_answers(evidence.added_to({**tables, "laws": study.table}))
            return ScenarioEstimate(tables, study.heaviest, vehicle.not_ended, named, verdict, evidence)
        chosen = chosen_law(scenario, law, records, seed)
        repeated = {
            name: {**config[name], "replicates": replicates} for name in ("importance_sampling", "surrogate")
        }
        settings = {**config, **repeated}
        made = compare_methods(scenario, {law: chosen}, vehicle, settings, [method], predecessor)
        estimate = made.pop("estimates")
        evidence = evidence_on(vehicle, replays, event, largest(estimate["ci_high"]))
    if not estimate["events"].any():
        runs = int((estimate["learning"] + estimate["estimating"]).sum())
        raise InputError(
            f"the law {law}",
            seen=f"no {named} of the vehicle {config['vehicle']['name']} in {runs:,} runs",
            expected="a law with probability where the event happens",
            change="Name another law, check its limits, or allow more runs (surrogate.maximum_calls).",
        )
    tables = verdict.added_to_answers(evidence.added_to(made | {"estimate": estimate}))
    return ScenarioEstimate(tables, chosen, vehicle.not_ended, named, verdict, evidence)


def verdict_on_law(scenario: Scenario, law: str, config: Mapping[str, Any]) -> Verdict:
    """Return the verdict on the records of a law, which a file of a law contains; see `chosen_law`.

    Raises
    ------
    InputError
        If a check has the verdict ``stop`` and ``data.accepted_warnings`` does not name it.
    """
    accepted = config["data"]["accepted_warnings"]
    if law.endswith(".json"):
        return read_verdict(law, accepted)
    known = load_vehicle(scenario.default_vehicle, scenario)
    where = config["scenario"]["records"] or f"records of the scenario {scenario.name} in the project"
    return verdict_on(configured_records(config, known.simulate), str(where), accepted)


def chosen_law(scenario: Scenario, law: str, records: pd.DataFrame, seed: int) -> JointLaw:
    """Return the joint law that a user has chosen.

    Parameters
    ----------
    scenario
        The scenario.
    law
        Path of the file of a joint law, which ends in ``.json``, or the name of a kind of joint law, which is
        fitted to the records.
    records
        Table of the records.
    seed
        Root seed.

    Raises
    ------
    InputError
        If the law is unknown, or the file or the records cannot be used.
    """
    if law.endswith(".json"):
        return read_scenario_law(scenario, law)
    if law not in JOINT_LAWS:
        raise InputError(
            "--law",
            seen=repr(law),
            expected=f"{ANSWER}, {', '.join(JOINT_LAWS)} or the file of a joint law (.json)",
            change="Name one of these.",
        )
    generator = child_generator(seed, "scenario", "law", law)
    return Candidate(law, law, {}).fit(clustered_records(scenario, records), generator)
