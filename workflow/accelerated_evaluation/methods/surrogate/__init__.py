"""The surrogate-guided sampler of few simulations, for vehicles whose simulation is dear."""

import os
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, ClassVar, Self

import numpy as np

from accelerated_evaluation.base.sections import Schema, integer, section
from accelerated_evaluation.methods import METHODS
from accelerated_evaluation.methods.estimate import Estimate, Method, Stopping
from accelerated_evaluation.methods.surrogate.certificate import BY_DEFAULT, Certificate
from accelerated_evaluation.methods.surrogate.constants import ENOUGH_REPEATS, FIRST_REPEATS
from accelerated_evaluation.methods.surrogate.gaussian_process import Predecessor
from accelerated_evaluation.methods.surrogate.sampler import Sampler
from accelerated_evaluation.methods.surrogate.state import read_state, write_state
from accelerated_evaluation.problem import Problem, ScoreProblem

SETTINGS = section(
    replicates=integer(
        10, 1, 1000, "Independent repetitions of the surrogate-guided estimate, its learning included."
    ),
    batch_size=integer(
        5,
        1,
        500,
        "Simulations that the sampler asks for at once; more keep more workers busy, but raise the total.",
    ),
    maximum_calls=integer(
        1000,
        100,
        100_000,
        "Simulations after which a replicate stops, learning included, converged or not.",
    ),
)


@METHODS.add("surrogate")
@dataclass(frozen=True)
class Surrogate(Method):
    """Learn where the event is while estimating its probability, by as few simulations as possible.

    Attributes
    ----------
    batch_size
        Simulations asked for at once. Small batches learn with fewer simulations, large ones keep more
        workers busy.
    state_file
        Where the state is saved after every batch; if the file exists, its runs are taken up, not repeated.
        Each problem needs a file of its own. By default nothing is saved.
    on_batch
        Called with the estimate after every batch, for example to show progress.
    certificate
        What must be excluded before an estimate has converged. Until it is, the sampler goes on looking for
        unseen parts of the event after the interval is narrow.
    predecessor
        Runs of another vehicle that is like the one under test, with events among them; see `Sampler`.
    """

    name: ClassVar[str] = "surrogate"
    look: ClassVar[dict[str, Any]] = {"color": "#6a3d9a", "linestyle": (0, (3, 1, 1, 1)), "marker": "D"}
    settings: ClassVar[dict[str, Schema]] = {"surrogate": SETTINGS}
    sections: ClassVar[tuple[str, ...]] = ("surrogate",)
    tables: ClassVar[tuple[str, ...]] = ("runs",)

    batch_size: int = 5
    state_file: str | os.PathLike | None = None
    on_batch: Callable[[Estimate], None] | None = None
    certificate: Certificate = BY_DEFAULT
    predecessor: Predecessor | None = None

    @classmethod
    def configured(cls, config: Mapping[str, Any]) -> Self:
        """Return the method with the settings of a configuration."""
        return cls(config["surrogate"]["batch_size"])

    @classmethod
    def replicates(cls, config: Mapping[str, Any]) -> int:
        """Return how many independent replicates the study runs."""
        return config["surrogate"]["replicates"]

    @classmethod
    def stopping(cls, config: Mapping[str, Any]) -> Stopping:
        """Return the paper's rule with this method's limit of simulations; a single event may be enough."""
        rule = Stopping.configured(config["importance_sampling"])
        return replace(rule, minimum_events=1, maximum_simulations=config["surrogate"]["maximum_calls"])

    def estimate(self, problem: ScoreProblem, stopping: Stopping, generator: np.random.Generator) -> Estimate:
        """Estimate the probability of the event by as few simulations as possible.

        Parameters
        ----------
        problem
            What is asked.
        stopping
            When to stop. A few dozen events are enough for this method, so ``minimum_events`` should be 1.
        generator
            Source of all randomness, unless a saved state is taken up, which has its own.

        Raises
        ------
        InputError
            If the state file is damaged, of another problem, of another batch size, or none of a sampler.
        """
        sampler = self._sampler(problem, generator)
        limit = stopping.maximum_simulations
        while not sampler.has_converged(stopping) and sampler.simulations + self.batch_size <= limit:
            z = sampler.ask(certify=sampler.is_narrow(stopping))
            again = getattr(problem, "repeat", problem.evaluate)
            sampler.tell(*(again(z) if sampler.repeats_next else problem.evaluate(z)))
            if self.state_file is not None:
                write_state(self.state_file, sampler.state())
            if self.on_batch is not None:
                self.on_batch(sampler.estimate(stopping))
        return sampler.estimate(stopping)

    def _sampler(self, problem: ScoreProblem, generator: np.random.Generator) -> Sampler:
        """Return the sampler of the state file, or a new one where there is no such file."""
        own = {"dimension": problem.dimension, "fingerprint": problem.fingerprint}
        if self.state_file is None or not Path(self.state_file).exists():
            return Sampler(
                **own,
                generator=generator,
                batch_size=self.batch_size,
                certificate=self.certificate,
                predecessor=self.predecessor,
                deterministic=getattr(problem, "deterministic", None),
                enough_repeats=ENOUGH_REPEATS if isinstance(problem, Problem) else FIRST_REPEATS,
            )
        state = read_state(self.state_file)
        state.check(**own, batch_size=self.batch_size, where=str(self.state_file))
        return Sampler.resume(state, self.certificate)
