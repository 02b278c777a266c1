# What the rules share: the validated configuration, path helpers, and the modules a rule depends on.
#
# In: config. Out: nothing; definitions only.

from pathlib import Path

from accelerated_evaluation.configuration import validate
from accelerated_evaluation.encounters.segments import segment_names
from accelerated_evaluation.errors import StudyError
from accelerated_evaluation.files import write_text
from accelerated_evaluation.sampling.methods import METHODS
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
MODEL = config["models"]["inverse_range"]["variant"]


wildcard_constraints:
    variable="inverse_range|inverse_ttc",
    segment="|".join(["all", *SEGMENTS]),
    scope="|".join(["all", *SEGMENTS]),
    method="|".join(METHODS),
    seed=r"\d+",


def library(*rooms: str) -> list[str]:
    """Modules of the library's rooms: Snakemake does not see that a script imports them."""
    shared = sorted(LIBRARY.glob("*.py"))
    return [
        str(path)
        for path in shared
        + [m for room in rooms for m in sorted((LIBRARY / room).glob("*.py"))]
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
