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
    """Return the normal quantile z(1 - alpha / 2): the half-width of an interval in standard errors."""
    return -float(ndtri(alpha / 2))


@dataclass(frozen=True)
class Stopping:
    """The rule that decides when an estimate is precise enough (paper, section VI.C).

    Attributes
    ----------
    alpha
        The level of the intervals is 100 (1 - alpha) %.
    beta
        An estimate has converged when the half-width of its interval is at most ``beta`` times the estimate.
    minimum_events
        Smallest number of events for convergence. It prevents that an estimate seems to have converged after
        a few events.
    maximum_simulations
        Number of simulations after which a method ends without convergence.
    anytime
        Whether the intervals keep their level although they are checked after every batch; see
        `surrogate.anytime`. Only the surrogate-guided sampler has such intervals.
    """

    alpha: float = 0.2
    beta: float = 0.2
    minimum_events: int = 100
    maximum_simulations: int = 100_000
    anytime: bool = False

    @classmethod
    def configured(cls, section: Mapping[str, Any]) -> Self:
        """Return the stopping rule with the settings of the section ``importance_sampling``."""
        return cls(**{name: section[name] for name in cls.__dataclass_fields__ if name != "anytime"})


@dataclass(frozen=True)
class Estimate:
    """The estimated probability of an event, in the form that all methods use.

    Attributes
    ----------
    probability, low, high
        The estimate and the ends of its interval. If there are too few events, the interval begins at 0 and
        ends at an upper limit, which is 1 in the worst case, and the estimate is 0 or NaN.
    alpha
        The level of the interval is 100 (1 - alpha) %.
    learning
        Number of simulations that were used for learning, and do not enter the estimate.
    estimating
        Number of simulations on which the estimate is based.
    events
        Number of events among the simulations that enter the estimate, or that the method counts instead.
    converged
        Whether the stopping rule is satisfied.
    diagnostics
        Additional numbers by name, which differ between the methods.
    tables
        Additional tables by name, which differ between the methods.
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
        """Total number of simulations, including those for learning."""
        return self.learning + self.estimating

    def covers(self, probability: float) -> bool:
        """Return whether the interval contains the given probability."""
        return self.low <= probability <= self.high

    def row(self) -> dict[str, Any]:
        """Return the estimate as a row of a table, by column; the diagnostics are the last columns."""
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
        """Return the number of independent replicates that the study runs with this method.

        By default it is the number in the section ``importance_sampling`` (ten in the paper).
        """
        return config["importance_sampling"]["replicates"]

    @classmethod
    def stopping(cls, config: Mapping[str, Any]) -> Stopping:
        """Return the stopping rule of this method for a configuration, by default the paper's rule."""
        return Stopping.configured(config["importance_sampling"])

    @classmethod
    def stream(cls, scope: str, replicate: int) -> tuple[str | int, ...]:
        """Return the name of the random stream of one replicate; streams with other names are independent.

        Parameters
        ----------
        scope
            The stratum, or ``all``.
        replicate
            Number of the replicate.
        """
        return cls.name, scope, replicate

    @abstractmethod
    def estimate(self, problem: ScoreProblem, stopping: Stopping, generator: np.random.Generator) -> Estimate:
        """Return the estimated probability of the event of a problem, with its interval.

        Parameters
        ----------
        problem
            The law, the vehicle and the event. Some methods need a `Problem`, others only a `ScoreProblem`.
        stopping
            The stopping rule.
        generator
            Source of all randomness.
        """
