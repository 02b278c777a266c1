"""What every method is asked for and gives: a stopping rule, one shape of estimate, one protocol."""

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
    """When an estimate is good enough (paper, section VI.C).

    Attributes
    ----------
    alpha
        Intervals are 100 (1 - alpha) %.
    beta
        An estimate has converged when the half-width of its interval is at most ``beta`` times the estimate.
    minimum_events
        Events that must have been seen besides, so that a lucky start does not count.
    maximum_simulations
        Simulations after which a method gives up.
    """

    alpha: float = 0.2
    beta: float = 0.2
    minimum_events: int = 100
    maximum_simulations: int = 100_000

    @classmethod
    def configured(cls, section: Mapping[str, Any]) -> Self:
        """Take the rule from the section ``importance_sampling`` of the configuration."""
        return cls(**{name: section[name] for name in cls.__dataclass_fields__})


@dataclass(frozen=True)
class Estimate:
    """The probability of an event, as any method gives it.

    Attributes
    ----------
    probability, low, high
        The estimate and its interval. Without enough events the interval is what can be said all the same,
        in the worst case [0, 1]; the estimate is then 0 or NaN.
    alpha
        The interval is one of 100 (1 - alpha) %.
    learning
        Simulations that do not enter the estimate, because they taught the method where to look.
    estimating
        Simulations that the estimate is made of.
    events
        Simulations, of those that the method counts, that ended in the event.
    converged
        Whether the interval is as narrow as the stopping rule asks.
    diagnostics
        Numbers that only some methods have, by name.
    tables
        Tables that only some methods have, by name: how an estimate came about.
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
        """All simulations, learning included."""
        return self.learning + self.estimating

    def covers(self, probability: float) -> bool:
        """Whether the interval holds a value."""
        return self.low <= probability <= self.high

    def row(self) -> dict[str, Any]:
        """Return the estimate as a row of a table; the diagnostics come last, under their names."""
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
    """A way to estimate the probability of an event.

    Attributes
    ----------
    name
        In the registry, in files and in tables.
    look
        Colour, line style and marker in figures.
    settings
        The sections of the configuration that this method adds, by name: schemas with defaults.
    sections
        Names of all sections of the configuration that `configured` reads.
    tables
        Names of the tables in its estimates.
    learns_apart
        Whether the study lets it learn in jobs of their own, whose results the replicates share.
    """

    name: ClassVar[str]
    look: ClassVar[Mapping[str, Any]]
    settings: ClassVar[Mapping[str, Schema]] = {}
    sections: ClassVar[tuple[str, ...]] = ()
    tables: ClassVar[tuple[str, ...]] = ()
    learns_apart: ClassVar[bool] = False

    @classmethod
    def configured(cls, config: Mapping[str, Any]) -> Self:
        """Return the method with the settings of a configuration, of which it reads ``sections`` alone."""
        return cls()

    @classmethod
    def replicates(cls, config: Mapping[str, Any]) -> int:
        """Return how many independent replicates the study runs; by default as many as the paper's ten."""
        return config["importance_sampling"]["replicates"]

    @classmethod
    def stopping(cls, config: Mapping[str, Any]) -> Stopping:
        """Return when the study lets this method stop; by default by the paper's rule."""
        return Stopping.configured(config["importance_sampling"])

    @classmethod
    def stream(cls, scope: str, replicate: int) -> tuple[str | int, ...]:
        """Return the names of the random stream of one replicate, see `randomness.child_generator`."""
        return cls.name, scope, replicate

    @abstractmethod
    def estimate(self, problem: ScoreProblem, stopping: Stopping, generator: np.random.Generator) -> Estimate:
        """Estimate the probability of the problem's event.

        Parameters
        ----------
        problem
            What is asked. A method that needs more than normal scores says so, and asks for a `Problem`.
        stopping
            When the estimate is good enough.
        generator
            Source of all randomness.
        """
