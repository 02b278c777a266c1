# What the rules share: the validated configuration, names, path helpers, and what a rule depends on.
#
# In: config. Out: nothing; definitions only.
#
# Results are written below the working directory. What belongs to this project is found from where its library is,
# because the two folders differ where another workflow uses this one as a module.

import os
from dataclasses import asdict
from pathlib import Path

from accelerated_evaluation.study.locks import release_dead_locks
from accelerated_evaluation.study.configuration import (
    WORKFLOW,
    completed,
    read_yaml,
    resolved,
    validate,
)
from accelerated_evaluation.base.digests import content_digest, value_digest
from accelerated_evaluation.study.dependencies import imported_modules, without_unused
from accelerated_evaluation.records.segments import segment_names
from accelerated_evaluation.records.sources import SOURCES, describe, record_files
from accelerated_evaluation.records.verdict import require_checks
from accelerated_evaluation.base.errors import StudyError
from accelerated_evaluation.methods import METHODS
from accelerated_evaluation.study.preflight import (
    compared_sections,
    require_cores,
    require_named,
    require_places,
    require_plain,
)
from accelerated_evaluation.vehicles.loading import section_files
from accelerated_evaluation.vehicles.external.slow import is_slow
from snakemake.exceptions import WorkflowError

# A job of a cluster runs on a machine of its own, which cannot tell whether the run that sent it is alive.
ALIVE = release_dead_locks() if workflow.is_main_process else None

try:
    for path in workflow.configfiles:
        read_yaml(Path(path))  # Snakemake takes the last of equal keys without a word
    config = completed(config)
    validate(config)
    config = resolved(
        config,
        record_files(config["data"][config["data"]["source"]]),
        Path("results") / config["study"] / "limits.json",
        trust=not workflow.is_main_process,
    )
except StudyError as error:
    raise WorkflowError(str(error)) from None

config = without_unused(config, SOURCES)
# What is accepted concerns the last job alone; an edit of it runs no other job again.
ACCEPTED = config["data"].pop("accepted_warnings")

STUDY = config["study"]
REPLICATED = [name for name in config["methods"] if METHODS[name].replicates(config)]
SEARCHING = [name for name in REPLICATED if METHODS[name].learns_apart]
JUDGED = [*SEARCHING, "crude"]
RESULTS = Path("results") / STUDY
FIGURES = Path("figures") / STUDY
PROJECT = Path(os.path.relpath(WORKFLOW.parent))
LIBRARY = PROJECT / "workflow/accelerated_evaluation"
SCRIPTS = PROJECT / "workflow/scripts"
SEGMENTS = segment_names(config["segments"]["lead_speed_edges"])
SEEDS = range(config["cross_entropy"]["seeds"])
MODEL = config["models"]["inverse_range"]["variant"]

# The user's own files count by their content, in the parameters of the rules, and not by their date.
SOURCE = config["data"][config["data"]["source"]]
if not Path(SOURCE["path"]).exists() and (PROJECT / SOURCE["path"]).exists():
    SOURCE["path"] = str(PROJECT / SOURCE["path"])  # the records of this project
if workflow.is_main_process:
    try:
        require_cores(workflow.resource_settings.cores)
        require_places(RESULTS, FIGURES)
        require_named(config)
        require_checks(ACCEPTED)
    except StudyError as error:
        raise WorkflowError(str(error)) from None
RECORDS = record_files(SOURCE)
DESCRIPTION = describe(config["data"])
VEHICLE = config["vehicle"]["name"]
VEHICLES = {
    "under_test": config["vehicle"],
    **compared_sections(config["compared_vehicles"]),
}
try:
    FILES = {name: section_files(section) for name, section in VEHICLES.items()}
    require_plain([*RECORDS, *(path for files in FILES.values() for path in files)])
except StudyError as error:
    raise WorkflowError(str(error)) from None
VEHICLE_FILES = FILES["under_test"]
VEHICLE_CONTENT = content_digest(VEHICLE_FILES)


def simulating(*names: str) -> tuple[int, dict]:
    """Threads and settings of a job that simulates vehicles: workers and their settings only for slow ones.

    How many workers there are is the number of threads, an edit of which runs nothing again.
    """
    settings = config["simulations"]
    slow = any(is_slow(VEHICLES[name]["name"], settings) for name in names)
    own = {
        key: value
        for key, value in settings.items()
        if key != "workers" and (slow or key == "keep_class")
    }
    return settings["workers"] if slow else 1, own


WORKERS, SIMULATIONS = simulating("under_test")
# The vehicle that most rules look up, for `modules_of`.
OF_VEHICLE = {"vehicles": [VEHICLE]}
SCOPES = ["all", SEGMENTS[0]]


wildcard_constraints:
    variable="inverse_range|inverse_ttc",
    segment="|".join(["all", *SEGMENTS]),
    scope="|".join(["all", *SEGMENTS]),
    method="|".join(SEARCHING),
    judged="|".join(JUDGED),
    seed=r"\d+",


def modules_of(script: str, *notebooks: str, members=None):
    """Modules of the library that a script and notebooks import: Snakemake does not look into them by itself.

    What is returned is an input function, so that a job parses what it needs, and not what all rules need.
    ``members`` gives, by room, the members of its registry that are looked up; it may be a function of the
    wildcards. Of a room that it does not name, all members count.
    """
    sources = [SCRIPTS / script, *notebooks]

    def modules(wildcards):
        looked_up = members(wildcards) if callable(members) else members
        return map(str, imported_modules(sources, LIBRARY, looked_up))

    return lambda wildcards: list(modules(wildcards))


def content_of_records(_) -> str:
    """Digest of the records."""
    return content_digest(RECORDS)


def description_of_data(_) -> str:
    """What outputs call the data. In what a function returns, Snakemake takes no braces for a wildcard."""
    return DESCRIPTION


def settings_of(method: str) -> dict:
    """Sections of the configuration that a method reads."""
    return part(config, *METHODS[method].sections)


def part(section: dict, *keys: str) -> dict:
    """Those keys of a section of the configuration that a rule uses; edits of the others do not concern it."""
    return {key: section[key] for key in keys}


def mapped(name: str, crash_map: dict) -> dict:
    """Everything that a crash map depends on. It belongs to the vehicle, so that all studies of one share it."""
    limits = part(config["filters"], "lead_speed_min", "lead_speed_max", "range_max")
    return {
        "vehicle": VEHICLES[name]["name"],
        "parameters": VEHICLES[name]["parameters"],
        "content": content_digest(FILES[name]),
        "limits": limits,
        "crash_map": crash_map,
        "seed": config["seed"],
    }


def map_of(description: dict, name: str) -> str:
    """Path of a file that belongs to a vehicle, described as by `mapped`, under a name made of all of it."""
    vehicle = Path(description["vehicle"].replace(":", "/")).name
    folder = f"{vehicle}-{value_digest(description)[:10]}"
    return str(Path("results/vehicles") / folder / name)


def result(*parts: str) -> str:
    """Path of a result of this study."""
    return str(RESULTS.joinpath(*parts))


def log_of(*parts: str) -> str:
    """Path of a log of this study."""
    return str(RESULTS.joinpath("logs", *parts))


def benchmark_of(*parts: str) -> str:
    """Path of a benchmark of this study: seconds and memory of the jobs of a rule."""
    return str(RESULTS.joinpath("benchmarks", *parts))


def estimates_of(table):
    """Files of a table that the methods give: of all methods, if all have it."""
    suffix = "" if table == "estimates" else f"_{table}"
    return [
        result("estimates", f"{scope}_{method}{suffix}.csv")
        for scope in SCOPES
        for method in REPLICATED
        if table in ("estimates", *METHODS[method].tables)
    ]
