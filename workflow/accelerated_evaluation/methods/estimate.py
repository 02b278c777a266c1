"""The common interface of all methods: stopping rule, estimate and method."""

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, ClassVar, Self

import numpy as np
import pandas as pd
from scipy.special import ndtri

from accelerated_evaluation.base.sections import Schema
from accelerated_evaluation.problem import ScoreProblem


def normal_reach(alpha: float) -> float:
    """Return half the width of a normal 100 (1 - alpha) % interval, in standard errors."""
    return -float(ndtri(alpha / 2))


@dataclass(frozen=True)
class Stopping:
    """The rule that decides when an estimate is precise enough (paper, section VI.C).

    Attributes
    ----------
    alpha
        Intervals have the level 100 (1 - alpha) %.
    beta
        An estimate has converged when the half-width of its interval is at most ``beta`` times the estimate.
    minimum_events
        Least number of events, which prevents convergence by chance after few events.
    maximum_simulations
        Number of simulations after which a method ends without convergence.
    anytime
        Whether the interval may be checked any number of times; see `surrogate.anytime`. Only the
        surrogate-guided sampler has such intervals.
    """

    alpha: float = 0.2
    beta: float = 0.2
    minimum_events: int = 100
    maximum_simulations: int = 100_000
    anytime: bool = False

    @classmethod
    def configured(cls, section: Mapping[str, Any]) -> Self:
        """Return the rule of the section ``importance_sampling`` of the configuration."""
        return cls(**{name: section[name] for name in cls.__dataclass_fields__ if name != "anytime"})


@dataclass(frozen=True)
class Estimate:
    """The estimated probability of an event, in the form that all methods use.

    Attributes
    ----------
    probability, low, high
        The estimate and its interval. If there are too few events, the interval is [0, bound], or [0, 1] in
        the worst case, and the estimate is 0 or NaN.
    alpha
        The level of the interval is 100 (1 - alpha) %.
    learning
        Number of simulations that do not enter the estimate, because they were used for learning.
    estimating
        Number of simulations on which the estimate is based.
    events
        Number of events among the simulations that the method counts.
    converged
        Whether the stopping rule is satisfied.
    diagnostics
        Further numbers of some methods, by name.
    tables
        Further tables of some methods, by name.
    """

    probability: float
    low: float
    high: float
    alpha: float
    learning: int
    estimating: int
    events: int
    converged: bool
    diagnostics: Mapping[str, float] = field(default_factory=dict)
    tables: Mapping[str, pd.DataFrame] = field(default_factory=dict)

    @property
    def simulations(self) -> int:
        """Number of all simulations, including those for learning."""
        return self.learning + self.estimating

    def covers(self, probability: float) -> bool:
        """Return whether the interval contains a value."""
        return self.low <= probability <= self.high

    def row(self) -> dict[str, Any]:
        """Return the estimate as a row of a table, with the diagnostics as last columns."""
        return {
            "probability": self.probability,
            "ci_low": self.low,
            "ci_high": self.high,
            "learning": self.learning,
            "estimating": self.estimating,
            "events": self.events,
            "converged": self.converged,
            **self.diagnostics,
        }


class Method(ABC):
    """A method that estimates the probability of an event.

    Attributes
    ----------
    name
        Name in the registry, in files and in tables.
    style
        Colour, line style and marker in figures.
    settings
        Sections of the configuration that this method adds, by name: schemas with defaults.
    sections
        Names of all sections of the configuration that `configured` reads.
    tables
        Names of the tables in its estimates.
    learns_apart
        Whether the study runs the learning in separate jobs, whose results the replicates share.
    """

    name: ClassVar[str]
    style: ClassVar[Mapping[str, Any]]
    settings: ClassVar[Mapping[str, Schema]] = {}
    sections: ClassVar[tuple[str, ...]] = ()
    tables: ClassVar[tuple[str, ...]] = ()
    learns_apart: ClassVar[bool] = False

    @classmethod
    def configured(cls, config: Mapping[str, Any]) -> Self:
        """Return the method with the settings of a configuration; only ``sections`` of it are read."""
        return cls()

    @classmethod
    def replicates(cls, config: Mapping[str, Any]) -> int:
        """Return the number of independent replicates of the study, by default the paper's ten."""
        return config["importance_sampling"]["replicates"]

    @classmethod
    def stopping(cls, config: Mapping[str, Any]) -> Stopping:
        """Return the stopping rule of this method in the study, by default the paper's rule."""
        return Stopping.configured(config["importance_sampling"])

    @classmethod
    def stream(cls, scope: str, replicate: int) -> tuple[str | int, ...]:
        """Return the names of the random stream of one replicate; see `randomness.child_generator`."""
        return cls.name, scope, replicate

    @abstractmethod
    def estimate(self, problem: ScoreProblem, stopping: Stopping, generator: np.random.Generator) -> Estimate:
        """Estimate the probability of the event of a problem.

        Parameters
        ----------
        problem
            The problem. Some methods need a `Problem`, others only a `ScoreProblem`.
        stopping
            The stopping rule.
        generator
            Source of all randomness.
        """
