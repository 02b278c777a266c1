# What the rules share: the checked configuration, names, path helpers, and what a rule depends on.
#
# In: config. Out: nothing; definitions only.
#
# Results are written below the working directory. What belongs to this project is found from where its library is,
# because the two folders differ where another workflow uses this one as a module.

import os
from dataclasses import asdict
from pathlib import Path

from accelerated_evaluation.base.digests import content_digest
from accelerated_evaluation.base.errors import StudyError
from accelerated_evaluation.methods import METHODS
from accelerated_evaluation.records.segments import segment_names
from accelerated_evaluation.study.configuration import WORKFLOW
from accelerated_evaluation.study.dependencies import imported_modules
from accelerated_evaluation.study.inputs import StudyInputs, map_folder, part
from snakemake.exceptions import WorkflowError

PROJECT = Path(os.path.relpath(WORKFLOW.parent))
try:
    INPUTS = StudyInputs.checked(
        config,
        workflow.configfiles,
        PROJECT,
        cores=workflow.resource_settings.cores,
        is_main_process=workflow.is_main_process,
    )
except StudyError as error:
    raise WorkflowError(str(error)) from None
config = INPUTS.config

STUDY = config["study"]
SCENARIO = config["scenario"]["name"]
IS_CUT_IN = SCENARIO == "cut_in"
JOINT = {"joint": []} if IS_CUT_IN else {}  # joint laws, of which cut-ins have none
RESULTS = Path("results") / STUDY
FIGURES = Path("figures") / STUDY
# Whether some 150 simulations have to be enough, so that there are no maps and no crude Monte Carlo.
SLOW = IS_CUT_IN and config["simulations"]["slow"]
REPLICATED = [name for name in config["methods"] if METHODS[name].replicates(config)]
SEARCHING = [name for name in REPLICATED if METHODS[name].learns_apart]
JUDGED = [*SEARCHING, "crude"]
SEGMENTS = segment_names(config["segments"]["lead_speed_edges"])
SCOPES = ["all", SEGMENTS[0]]
SEEDS = range(config["cross_entropy"]["seeds"])
MODEL = config["models"]["inverse_range"]["variant"]

# The user's own files count by their content, in the parameters of the rules, and not by their date.
RECORDS = INPUTS.records
ACCEPTED = INPUTS.accepted
VEHICLES = INPUTS.vehicles
VEHICLE_FILES = INPUTS.files_of("under_test")
VEHICLE_CONTENT = INPUTS.content_of("under_test")
WORKERS, SIMULATIONS = INPUTS.simulating("under_test")
OF_VEHICLE = {"vehicles": [config["vehicle"]["name"]]}  # what most rules look up


wildcard_constraints:
    scope="|".join(["all", *SEGMENTS]),
    method="|".join(SEARCHING),
    judged="|".join(JUDGED),


def modules_of(script: str, *notebooks: str, members=None):
    """Modules of the library that a script and notebooks import: Snakemake does not look into them by itself.

    What is returned is an input function, so that a job parses what it needs, and not what all rules need.
    ``members`` gives, by room, the members of its registry that are looked up; it may be a function of the
    wildcards. Of a room that it does not name, all members count.
    """
    sources = [PROJECT / "workflow/scripts" / script, *notebooks]
    library = PROJECT / "workflow/accelerated_evaluation"

    def modules(wildcards):
        looked_up = members(wildcards) if callable(members) else members
        all_looked_up = {"scenarios": [SCENARIO]} | JOINT | (looked_up or {})
        return [str(path) for path in imported_modules(sources, library, all_looked_up)]

    return modules


def content_of_records(_) -> str:
    """Digest of the records."""
    return content_digest(RECORDS)


def settings_of(method: str) -> dict:
    """Sections of the configuration that a method reads."""
    return part(config, *METHODS[method].sections)


def result(*parts: str) -> str:
    """Path of a result of this study."""
    return str(RESULTS.joinpath(*parts))


def log_of(*parts: str) -> str:
    """Path of a log of this study."""
    return str(RESULTS.joinpath("logs", *parts))


def benchmark_of(*parts: str) -> str:
    """Path of a benchmark of this study: seconds and memory of the jobs of a rule."""
    return str(RESULTS.joinpath("benchmarks", *parts))


def searched(suffix, *methods):
    """Files that the searches of some methods give, one for each seed."""
    return [
        result("cross_entropy", f"{method}_{seed}{suffix}")
        for method in methods
        for seed in SEEDS
    ]


def estimates_of(table):
    """Files of a table that the methods give: of all methods, if all have it."""
    suffix = "" if table == "estimates" else f"_{table}"
    return [
        result("estimates", f"{scope}_{method}{suffix}.csv")
        for scope in SCOPES
        for method in REPLICATED
        if table in ("estimates", *METHODS[method].tables)
    ]


def answered(name: str) -> dict:
    """All that the map of a vehicle depends on; only that of the vehicle under test has other events than crashes."""
    events = config["answer"]["events"]
    if name != "under_test":
        events = {quantity: [] for quantity in events}
    return INPUTS.mapped(name, {"grid": config["answer"]["grid"], "events": events})
