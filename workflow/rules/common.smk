# Definitions for all rules: the checked configuration, names, and functions for paths.
#
# In: config. Out: nothing; definitions only.
#
# Results are written below the working directory. Files of this project are found from the path of its library,
# because the project is in another folder if another workflow uses this one as a module.

import os
import sys
from dataclasses import asdict
from pathlib import Path

from accelerated_evaluation.answer.consequences.injuries.tables import RISKS
from accelerated_evaluation.answer.second_ways import ROWS
from accelerated_evaluation.answer.settings import law_settings, support_of
from accelerated_evaluation.base.errors import StudyError
from accelerated_evaluation.base.files import content_digest
from accelerated_evaluation.methods import METHODS, configured_stopping
from accelerated_evaluation.publishing.explorer import EXPLORED
from accelerated_evaluation.publishing.study import TABLES
from accelerated_evaluation.records.segments import segment_names
from accelerated_evaluation.scenarios import SCENARIOS
from accelerated_evaluation.study.configuration import WORKFLOW
from accelerated_evaluation.study.dependencies import code_up_to
from accelerated_evaluation.study.inputs import (
    MODULES_OF_STUDIES,
    StudyInputs,
    map_folder,
    part,
    require_same_modules,
)
from snakemake.exceptions import WorkflowError
from snakemake_interface_executor_plugins.settings import DeploymentMethod

PROJECT = Path(os.path.relpath(WORKFLOW.parent))
# The locked environment as an image for Apptainer, which `make container` builds from the Dockerfile. It is used only
# with --software-deployment-method apptainer; otherwise jobs run in the environment of Snakemake.
IMAGE = PROJECT / "environment.sif"
if (
    DeploymentMethod.APPTAINER in workflow.deployment_settings.deployment_method
    and not IMAGE.is_file()
):
    raise WorkflowError(
        f"{IMAGE}: seen no such file; expected the image for --software-deployment-method apptainer. Build it with "
        "`make container`, or leave the option out, because the environment of Snakemake has all packages."
    )


container: str(IMAGE)


try:
    INPUTS = StudyInputs.checked(
        config,
        workflow.configfiles,
        PROJECT,
        cores=workflow.resource_settings.cores,
        is_main_process=workflow.is_main_process,
        moved=workflow.modifier.path_modifier.replace_prefix,
    )
    require_same_modules(
        MODULES_OF_STUDIES, INPUTS.config["study"], INPUTS.config["modules"]
    )
except StudyError as error:
    raise WorkflowError(str(error)) from None
config = INPUTS.config

STUDY = config["study"]
SCENARIO = config["scenario"]["name"]
HAS_EXPLORER = SCENARIO in EXPLORED
LIMITS = support_of(SCENARIOS[SCENARIO], config)
SUPPORT = None if LIMITS is None else LIMITS.content()
RESULTS = Path("results") / STUDY
FIGURES = Path("figures") / STUDY
# Whether the vehicle is slow to simulate: a few hundred simulations are made, but no crash map and no crude Monte Carlo.
SLOW = config["simulations"]["slow"]
REPLICATED = [
    name
    for name in config["methods"]
    if METHODS[name].replicates(part(config, *METHODS[name].plan))
]
SEARCHING = [name for name in REPLICATED if METHODS[name].learns_apart]
JUDGED = [*SEARCHING, "crude"]
SEGMENTS = segment_names(config["segments"]["lead_speed_edges"])
SCOPES = ["all", SEGMENTS[0]]
SEEDS = range(config["cross_entropy"]["seeds"])
MODEL = config["models"]["inverse_range"]["variant"]

# Changes of the user's own files are recognised by their content, which is in the parameters of rules, not by dates.
RECORDS = INPUTS.records.files
ACCEPTED = INPUTS.accepted
VEHICLES = INPUTS.vehicles
VEHICLE_FILES = INPUTS.files_of("under_test")
VEHICLE_CONTENT = INPUTS.content_of("under_test")
WORKERS, SIMULATIONS = INPUTS.simulating("under_test")
# Parameters of rules that simulate the vehicle under test.
UNDER_TEST = {
    "vehicle": config["vehicle"],
    "vehicle_content": VEHICLE_CONTENT,
    "simulations": SIMULATIONS,
}

# Parts of the library whose extensions are used under the paper's law, under any law, and in the notebooks.
UNDER_PAPER = ("laws/distributions", "scenarios", "vehicles")
SIMULATING = ("laws", "scenarios", "vehicles")
SHOWN = (*SIMULATING, "records", "methods")


wildcard_constraints:
    scope="|".join(["all", *SEGMENTS]),
    method="|".join(SEARCHING),
    judged="|".join(JUDGED),


def content_of_records(_) -> str:
    """SHA-256 of the files of records."""
    return content_digest(RECORDS)


def settings_of(method: str) -> dict:
    """Sections of the configuration that a method reads."""
    return part(config, *METHODS[method].sections)


def plan_of(method: str) -> dict:
    """Number of replicates and stopping rule of a method."""
    plan = part(config, *METHODS[method].plan)
    return {
        "replicates": METHODS[method].replicates(plan),
        "stopping": asdict(METHODS[method].stopping(plan)),
    }


def result(*parts: str) -> str:
    """Path of a result of this study."""
    return str(RESULTS.joinpath(*parts))


def of_project(*parts: str) -> str:
    """Path of a file of this project. The prefix of a module does not move it."""
    return local(str(PROJECT.joinpath(*parts)))


def folders_of_study(_, output) -> dict:
    """Folders of the results and the figures of this study, with the prefix of a module if there is one."""
    own = str(RESULTS), str(FIGURES)
    prefix = next(
        path.partition(folder)[0] for path in output for folder in own if folder in path
    )
    return {"results": f"{prefix}{RESULTS}", "figures": f"{prefix}{FIGURES}"}


def tables_of_laws(*names):
    """Paths of tables of the answer, by their names."""
    return {name: result("laws", f"{name}.csv") for name in dict.fromkeys(names)}


def log_of(*parts: str) -> str:
    """Path of a log of this study."""
    return str(RESULTS.joinpath("logs", *parts))


def benchmark_of(*parts: str) -> str:
    """Path of a benchmark of this study: seconds and memory of the jobs of a rule."""
    return str(RESULTS.joinpath("benchmarks", *parts))


def no_explorer(_):
    """Stop with the reason why the scenario has no explorer."""
    raise WorkflowError(
        f"the scenario {SCENARIO} has no explorer, because it is not known that along one of its variables every"
        " event happens in a few intervals; change the vehicle in the configuration and compare the answers instead."
    )


def searched(suffix, *methods):
    """Files that the searches of some methods write, one for each method and seed."""
    return [
        result("cross_entropy", f"{method}_{seed}{suffix}")
        for method in methods
        for seed in SEEDS
    ]


def estimates_of(table):
    """Files of one kind of table, for all scopes and all methods that write it."""
    suffix = "" if table == "estimates" else f"_{table}"
    return [
        result("estimates", f"{scope}_{method}{suffix}.csv")
        for scope in SCOPES
        for method in REPLICATED
        if table in ("estimates", *METHODS[method].tables)
    ]


def answered(name: str) -> dict:
    """Everything on which the map of a vehicle depends. Only the vehicle under test has events other than crashes."""
    events = config["answer"]["events"]
    if name != "under_test":
        events = {quantity: [] for quantity in events}
    return INPUTS.mapped(name, {"grid": config["answer"]["grid"], "events": events})


# FOLDERS has the folder of each vehicle's map, which all studies of the vehicle share; UNCAPPED has the vehicle of each
# folder. In a study of a slow vehicle, vehicles whose outcomes are stored are too slow for a map.
MAPPED_VEHICLES = [
    name for name in VEHICLES if SUPPORT and not (SLOW and name in INPUTS.slow)
]
FOLDERS = {name: map_folder(answered(name)) for name in MAPPED_VEHICLES}
UNCAPPED = {Path(folder).name: name for name, folder in FOLDERS.items()}
ALL_FILES, ALL_CONTENT = INPUTS.files_of(*VEHICLES), INPUTS.content_of(*VEHICLES)
ALL_WORKERS, ALL_SIMULATIONS = INPUTS.simulating(*VEHICLES)
