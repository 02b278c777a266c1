# What the rules share: the validated configuration, path helpers, and the modules a rule depends on.
#
# In: config. Out: nothing; definitions only.

from pathlib import Path

from accelerated_evaluation.configuration import validate
from accelerated_evaluation.encounters.segments import segment_names
from accelerated_evaluation.errors import StudyError
from accelerated_evaluation.files import write_text
from accelerated_evaluation.methods.paper import METHODS
from snakemake.exceptions import WorkflowError

try:
    validate(config)
except StudyError as error:
    raise WorkflowError(str(error)) from None

STUDY = config["study"]
RESULTS = Path("results") / STUDY
FIGURES = Path("figures") / STUDY
LIBRARY = Path("workflow/accelerated_evaluation")
SEGMENTS = segment_names(config["segments"]["lead_speed_edges"])
SEEDS = range(config["cross_entropy"]["seeds"])
MODELS = ["two_pieces", "three_pieces", "single"]
FIGURE_FORMATS = ["png", "pdf", "svg", "csv"]
TABLE_FORMATS = ["csv", "md", "tex"]
MODEL = config["models"]["inverse_range"]["variant"]


wildcard_constraints:
    variable="inverse_range|inverse_ttc",
    segment="|".join(["all", *SEGMENTS]),
    scope="|".join(["all", *SEGMENTS]),
    method="|".join(METHODS),
    judged="|".join([*METHODS, "crude"]),
    seed=r"\d+",


def library(*rooms: str) -> list[str]:
    """Modules of the library's rooms: Snakemake does not see that a script imports them."""
    shared = [
        LIBRARY / name for name in ("errors.py", "files.py", "jobs.py", "randomness.py")
    ]
    return [
        str(path)
        for path in shared
        + [m for room in rooms for m in sorted((LIBRARY / room).rglob("*.py"))]
    ]


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
