"""Methods that estimate the probability of an event, their common interface, and their registry."""

from abc import ABC, abstractmethod
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar, Self

import numpy as np
from fewruns.errors import InputError as SamplerInputError
from fewruns.estimates import Estimate
from fewruns.estimates import Stopping as StoppingOfSampler
from scipy.special import ndtri

from accelerated_evaluation.base.checking import checked
from accelerated_evaluation.base.errors import InputError
from accelerated_evaluation.base.registry import Registry
from accelerated_evaluation.base.sections import Schema, Sections, integer, section, share

if TYPE_CHECKING:
    from accelerated_evaluation.methods.problem import Problem

IMPORTANCE_SAMPLING = section(
    replicates=integer(
        10,
        1,
        1000,
        "Number of independent repetitions (replicates) of each estimate (section VI.C).",
    ),
    alpha=share(0.2, "The confidence level of intervals is 1 - alpha (section VI.C)."),
    beta=share(0.2, "Relative half-width of the interval at which an estimate has converged (section VI.C)."),
    minimum_events=integer(
        100,
        1,
        1_000_000_000,
        "Least number of crashes with which an estimate can have converged.",
    ),
    simulations=integer(
        20_000,
        100,
        1_000_000_000,
        "Simulations of a replicate, also if it converges earlier. As many are added until it has converged.",
    ),
    maximum_simulations=integer(
        100_000,
        100,
        1_000_000_000,
        "Number of simulations after which a replicate stops even if it has not converged.",
    ),
    course_step=integer(
        50,
        1,
        1_000_000,
        "Number of simulations after each of which the running estimate is saved (figures 12 and 13).",
    ),
)


@contextmanager
def study_errors() -> Iterator[None]:
    """Convert an `InputError` of the sampler into one of the study, which is printed without a traceback."""
    try:
        yield
    except SamplerInputError as error:
        raise InputError(
            error.where, seen=error.seen, expected=error.expected, change=error.change
        ) from error


@checked()
@dataclass(frozen=True)
class Stopping(StoppingOfSampler):  # noqa: D101
    __doc__ = StoppingOfSampler.__doc__

    def __post_init__(self) -> None:
        """Check the values."""
        with study_errors():
            super().__post_init__()


def normal_reach(alpha: float) -> float:
    """Return the normal quantile z(1 - alpha / 2): the half-width of an interval in standard errors."""
    return -float(ndtri(alpha / 2))


def configured_stopping(section: Mapping[str, Any]) -> Stopping:
    """Return the stopping rule with the settings of the section ``importance_sampling``."""
    names = ("alpha", "beta", "minimum_events", "maximum_simulations")
    return Stopping(**{name: section[name] for name in names})


class Method(ABC):
    """A method that estimates the probability of an event."""

    name: ClassVar[str]  # in the registry, in files and in tables
    style: ClassVar[Mapping[str, Any]]  # colour, line style and marker in figures
    # Sections of the configuration that this method adds, by name: schemas with defaults.
    settings: ClassVar[Mapping[str, Schema]] = {}
    # Names of all sections of the configuration that `configured` reads.
    sections: ClassVar[tuple[str, ...]] = ()
    # Names of those that `replicates` and `stopping` read.
    plan: ClassVar[tuple[str, ...]] = ("importance_sampling",)
    tables: ClassVar[tuple[str, ...]] = ()  # names of the tables that a study keeps
    # Whether the study runs the learning in separate jobs, whose results the replicates share.
    learns_apart: ClassVar[bool] = False

    @classmethod
    def configured(cls, sections: Sections) -> Self:
        """Return the method with the settings of its ``sections`` of the configuration."""
        return cls()

    @classmethod
    def replicates(cls, sections: Sections) -> int:
        """Return the number of independent replicates that the study runs with this method.

        By default it is the number in the section ``importance_sampling`` (ten in the paper).
        """
        return sections["importance_sampling"]["replicates"]

    @classmethod
    def stopping(cls, sections: Sections) -> Stopping:
        """Return the stopping rule of this method, by default the paper's rule."""
        return configured_stopping(sections["importance_sampling"])

    @classmethod
    def stream(cls, scope: str, replicate: int) -> tuple[str | int, ...]:
        """Return the name of the random stream of a replicate in a stratum, or in ``all`` strata.

        Streams with other names are independent.
        """
        return cls.name, scope, replicate

    @abstractmethod
    def estimate(self, problem: "Problem", stopping: Stopping, generator: np.random.Generator) -> Estimate:
        """Return the estimated probability of the event of a problem, with its interval.

        Some methods need a problem with a `StratifiedLaw`, others only normal scores.
        """


METHODS: Registry[type[Method]] = Registry("method", __name__, __path__, "name", contract=[Method])

__all__ = ["METHODS", "Estimate", "Method", "Stopping", "configured_stopping", "normal_reach"]
