"""The vehicles of the study under its laws: exact probabilities, the sampler, and exported sets of scenarios.

``vehicles.smk`` calls the steps: a crash map of each vehicle, all vehicles under a law, the table, the sets.
"""

import argparse
import contextlib
import re
import tempfile
from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pandas as pd
from accelerated_evaluation import FittedRecords, LawStudy, choose_draws, read_records
from accelerated_evaluation.answer.settings import law_settings
from accelerated_evaluation.answer.ways.choice import ANSWER, PAPER
from accelerated_evaluation.base.files import write_csv
from accelerated_evaluation.base.randomness import child_generator
from accelerated_evaluation.commands.export import SAFE
from accelerated_evaluation.crash_map.exact import exact_probabilities
from accelerated_evaluation.crash_map.mapping import map_crashes
from accelerated_evaluation.crash_map.maps import CrashMap, Grid, read_crash_map, write_crash_map
from accelerated_evaluation.crash_map.sampled import sample_crashes
from accelerated_evaluation.laws import Law
from accelerated_evaluation.methods.problem import Problem as CutInProblem
from accelerated_evaluation.publishing.tables.display import reproducible
from accelerated_evaluation.scenarios.cut_in import CUT_IN
from accelerated_evaluation.study.configuration import load
from accelerated_evaluation.study.preflight import compared_sections
from accelerated_evaluation.track.export import page
from accelerated_evaluation.track.weighted_set import MOST, WeightedSet, draw_weighted_set
from accelerated_evaluation.vehicles import Vehicle, load_vehicle
from accelerated_evaluation.vehicles.protocol import repeats_itself
from problems import Problem
from run import ROOT, repeated
from summarise import summary

METHOD = "surrogate"
# The paper's law; of those with dependence the heaviest, another one with two kinds of drivers, and the one
# under which the car under test crashes least often.
LAWS = {"paper": PAPER, "answer": ANSWER, "two_kinds": "two kinds 0.98", "hazard": "hazard"}
SETS, LEVELS = (
    400,
    (80, 95),
)  # number of exported sets under the law ``answer``, and levels of their intervals
STRIPED = ("reg157",)  # crashes in stripes that the scan of a map would miss
LEAST = 1e-12  # probability below which the sampler is not asked
LIMITS = ("lead_speed_min", "lead_speed_max", "range_max")
SHOWN = (
    *("seeds", "calls_mean", "calls_p95", "bias", "bias_se", "error", "failed", "claimed"),
    *("coverage80", "coverage80_se", "coverage95"),
)


def vehicles() -> dict[str, dict]:
    """Return the parameters of the study's vehicles by name, the car under test first.

    A vehicle whose outcomes are random is left out.
    """
    config = load()
    sections = [config["vehicle"], *compared_sections(config["compared_vehicles"]).values()]
    parameters = {section["name"]: section["parameters"] for section in sections}
    return {
        name: given
        for name, given in parameters.items()
        if repeats_itself(load_vehicle(name, **given)) is not False
    }


def mapped(name: str) -> CrashMap:
    """Map the crashes of a vehicle on the grid of the study's answer, without a cap on closing speeds."""
    config, vehicle = load(), load_vehicle(name, **vehicles()[name])
    grid = Grid(**{key: config["filters"][key] for key in LIMITS}, **config["answer"]["grid"])
    if name not in STRIPED:
        return map_crashes(vehicle, grid, [], child_generator(ROOT, "vehicles", "map", name))
    # Half as fine, because a law takes minutes for all the steps that crash in a finer one.
    lines = map_crashes(vehicle, grid.refined(0.5), [], child_generator(ROOT, "vehicles", "map", name))
    return sample_crashes(vehicle, lines, child_generator(ROOT, "vehicles", "sample", name))


def single_law(choice: str, records: FittedRecords, config: Mapping) -> Law:
    """Return the paper's law, or a fitted smooth law: for ``answer``, the one with the largest weight."""
    if choice == PAPER:
        return choose_draws(choice, records, config).proposal
    own = law_settings(records.scenario, config)
    study = LawStudy.of(records, own.draws, own.streams, own.store, own.closing_speed_max)
    return study.law() if choice == ANSWER else study.smooth.law(choice)


def estimated(key: str, law: Law, maps: Mapping[str, CrashMap], seeds: int) -> pd.DataFrame:
    """Return the exact probability of each vehicle under a law, and the estimates of all seeds.

    Parameters
    ----------
    key
        How the table calls the law.
    law
        The law of cut-ins.
    maps
        Crash maps of the study's vehicles by name.
    seeds
        Number of estimates of each vehicle.

    Returns
    -------
    pandas.DataFrame
        Columns ``law``, ``vehicle``, ``exact`` and ``exact_se``, and those of `run.repeated`, a row a seed;
        one row without an estimate for a vehicle whose probability is below 1e-12.
    """
    parts = []
    for name, crash_map in maps.items():
        exact = exact_probabilities(crash_map, law)["all"]
        known = {"law": key, "vehicle": name, "exact": exact.probability, "exact_se": exact.standard_error}
        runs = pd.DataFrame({"seed": [None]})
        if exact.probability >= LEAST:
            crash = CutInProblem(CUT_IN, load_vehicle(name, **vehicles()[name]), law=law)
            runs = repeated(Problem(f"{key} {name}", crash), METHOD, range(seeds))
        parts.append(runs.assign(**known))
    return pd.concat(parts, ignore_index=True)


def table(runs: pd.DataFrame) -> pd.DataFrame:
    """Sum up all runs: a row for each law and vehicle, with the columns of `summarise.summary`."""
    rows = []
    for names, of_vehicle in runs.groupby(["law", "vehicle", "exact", "exact_se"], sort=False):
        known = dict(zip(("law", "vehicle", "exact", "exact_se"), names, strict=True))
        made = of_vehicle.dropna(subset="seed")
        rows.append(known | (summary(made, known["exact"]) if len(made) else {"seeds": 0}))
    return pd.DataFrame(rows).reindex(columns=["law", "vehicle", "exact", "exact_se", *SHOWN])


def exported(law: Law, maps: Mapping[str, CrashMap], sets: int) -> pd.DataFrame:
    """Compare estimates from exported sets of 300 cut-ins with the exact probability of each vehicle."""
    drawn = [draw_weighted_set(law, MOST, SAFE, child_generator(ROOT, "set", k)) for k in range(sets)]
    rows = []
    for name, crash_map in maps.items():
        exact = exact_probabilities(crash_map, law)["all"].probability
        vehicle = load_vehicle(name, **vehicles()[name])
        found = pd.DataFrame([followed(each, vehicle) for each in drawn])
        ratio = found["probability"] / exact
        row = {"vehicle": name, "exact": exact, "sets": sets, "mean": ratio.mean()}
        row |= {"error": np.sqrt(np.square(ratio - 1).mean())}
        for level in LEVELS:
            row[f"coverage{level}"] = (
                found[f"low{level}"].le(exact).mul(found[f"high{level}"].ge(exact)).mean()
            )
        rows.append(row | {"assumed_safe": drawn[0].assumed_safe})
    return pd.DataFrame(rows)


def followed(drawn: WeightedSet, vehicle: Vehicle) -> dict[str, float]:
    """Follow the page of a set: simulate its scenarios, and run the script of the page for both levels."""
    script = re.search(r"```python\n(.*?)```", page(drawn, {}, CUT_IN), re.DOTALL)[1]
    crash = vehicle.simulate(*drawn.table[["lead_speed", "range", "closing_speed"]].to_numpy().T).crash
    outcomes, found = drawn.table[["scenario"]].assign(crash=crash.astype(int)), {}
    with tempfile.TemporaryDirectory() as folder, contextlib.chdir(folder), contextlib.redirect_stdout(None):
        drawn.table.to_csv("scenarios.csv", index=False)
        outcomes.to_csv("outcomes.csv", index=False)
        for level in LEVELS:
            made: dict[str, float] = {}
            exec(script.replace("confidence = 0.80", f"confidence = {level / 100}"), made)
            found |= {"probability": made["probability"]}
            found |= {f"low{level}": made["low"], f"high{level}": made["high"]}
    return found


def main() -> None:
    """Make one of the steps."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    steps = parser.add_subparsers(dest="step", required=True)
    for step, argument in (("map", "vehicle"), ("run", "law"), ("table", "runs"), ("sets", "maps")):
        one = steps.add_parser(step)
        one.add_argument(argument, nargs="+" if argument in ("runs", "maps") else None)
        one.add_argument("--output", required=True)
        if step == "run":
            one.add_argument("--seeds", type=int, required=True, help="estimates of each vehicle")
            one.add_argument("--maps", type=Path, required=True, help="folder of the files VEHICLE.npz")
    arguments = parser.parse_args()
    if arguments.step == "map":
        write_crash_map(arguments.output, mapped(arguments.vehicle))
    elif arguments.step == "run":
        config = load()
        maps = {name: read_crash_map(arguments.maps / f"{name}.npz") for name in vehicles()}
        law = single_law(LAWS[arguments.law], read_records(config), config)
        write_csv(arguments.output, estimated(arguments.law, law, maps, arguments.seeds))
    elif arguments.step == "sets":
        config, maps = load(), {Path(path).stem: read_crash_map(path) for path in arguments.maps}
        law = single_law(ANSWER, read_records(config), config)
        write_csv(arguments.output, reproducible(exported(law, maps, SETS)))
    else:
        whole = table(pd.concat(map(pd.read_csv, arguments.runs), ignore_index=True))
        write_csv(arguments.output, reproducible(whole))


if __name__ == "__main__":
    main()
