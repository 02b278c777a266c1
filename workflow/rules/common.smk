# What the rules share: the validated configuration, names, path helpers, and what a rule depends on.
#
# In: config. Out: nothing; definitions only.

from pathlib import Path

from accelerated_evaluation.alive import release_dead_locks
from accelerated_evaluation.configuration import validate
from accelerated_evaluation.dependencies import (
    content_digest,
    imported_modules,
    value_digest,
    without_unused,
)
from accelerated_evaluation.encounters.segments import segment_names
from accelerated_evaluation.errors import StudyError
from accelerated_evaluation.methods.paper import METHODS
from snakemake.exceptions import WorkflowError

ALIVE = release_dead_locks()

try:
    validate(config)
except StudyError as error:
    raise WorkflowError(str(error)) from None

config = without_unused(config)

STUDY = config["study"]
RESULTS = Path("results") / STUDY
FIGURES = Path("figures") / STUDY
LIBRARY = Path("workflow/accelerated_evaluation")
SCRIPTS = Path("workflow/scripts")
SEGMENTS = segment_names(config["segments"]["lead_speed_edges"])
SEEDS = range(config["cross_entropy"]["seeds"])
MODELS = ["two_pieces", "three_pieces", "single"]
MODEL = config["models"]["inverse_range"]["variant"]
JUDGED = [*METHODS, "crude"]
FIGURE_FORMATS = ["png", "pdf", "svg", "csv"]
TABLE_FORMATS = ["csv", "md", "tex"]

# The user's own files count by their content, in the parameters of the rules, and not by their date.
SOURCE = config["data"][config["data"]["source"]]
RECORDS = [SOURCE[key] for key in ("path", "model", "lead_speed") if key in SOURCE]
VEHICLE = config["vehicle"]["name"]
VEHICLE_FILES = [VEHICLE.rsplit(":", 1)[0]] if ".py:" in VEHICLE else []
VEHICLE_CONTENT = content_digest(VEHICLE_FILES)

# Everything that the crash map depends on. It belongs to the vehicle, so that all studies of one share it.
MAPPED = {
    "vehicle": VEHICLE,
    "parameters": config["vehicle"]["parameters"],
    "content": VEHICLE_CONTENT,
    "limits": {
        "lead_speed_min": config["filters"]["lead_speed_min"],
        "lead_speed_max": config["filters"]["lead_speed_max"],
        "range_max": config["filters"]["range_max"],
        "closing_speed_max": config["vehicle"]["closing_speed_max"],
    },
    "crash_map": config["crash_map"],
    "seed": config["seed"],
}
VEHICLE_RESULTS = Path("results/vehicles") / "-".join(
    [Path(VEHICLE.replace(":", "/")).name, value_digest(MAPPED)[:10]]
)


wildcard_constraints:
    variable="inverse_range|inverse_ttc",
    segment="|".join(["all", *SEGMENTS]),
    scope="|".join(["all", *SEGMENTS]),
    method="|".join(METHODS),
    judged="|".join(JUDGED),
    seed=r"\d+",


def modules_of(script: str, *notebooks: str):
    """Modules of the library that a script and notebooks import: Snakemake does not look into them by itself.

    What is returned is an input function, so that a job parses what it needs, and not what all rules need.
    """
    sources = [SCRIPTS / script, *notebooks]
    return lambda _: [str(module) for module in imported_modules(sources, LIBRARY)]


def content_of_records(_) -> str:
    """Digest of the records; those that are not retrieved yet will have the checksum of the configuration."""
    return content_digest(RECORDS, missing=SOURCE.get("sha256", ""))


def part(section: dict, *keys: str) -> dict:
    """Those keys of a section of the configuration that a rule uses; edits of the others do not concern it."""
    return {key: section[key] for key in keys}


def result(*parts: str) -> str:
    """Path of a result of this study."""
    return str(RESULTS.joinpath(*parts))


def log_of(*parts: str) -> str:
    """Path of a log of this study."""
    return str(RESULTS.joinpath("logs", *parts))


def benchmark_of(*parts: str) -> str:
    """Path of a benchmark of this study: seconds and memory of the jobs of a rule."""
    return str(RESULTS.joinpath("benchmarks", *parts))


def in_report(path, category, name):
    """Show a file in the report, under its category and with the caption of its name."""
    caption = f"{workflow.basedir}/workflow/report/{name if category != 'Notebooks' else 'notebook'}.rst"
    return report(path, caption=caption, category=category, labels={"name": name})


def made(notebook, kind):
    """Files of a kind, figures or tables, that a notebook makes; the first format goes into the report."""
    folder, formats = {
        "figures": (FIGURES, FIGURE_FORMATS),
        "tables": (FIGURES / "tables", TABLE_FORMATS),
    }[kind]
    paths = []
    for name in NOTEBOOKS[notebook].get(kind, []):
        first, *others = [str(folder / f"{name}.{extension}") for extension in formats]
        paths += [in_report(first, kind.capitalize(), name), *others]
    return paths


def published(kind):
    """Files of a kind that all notebooks make: notebooks (as HTML), figures or tables."""
    if kind == "notebooks":
        return [result("notebooks", f"{notebook}.html") for notebook in NOTEBOOKS]
    return [path for notebook in NOTEBOOKS for path in made(notebook, kind)]
