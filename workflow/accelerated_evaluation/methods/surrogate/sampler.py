"""Surrogate-guided two-phase sampling: the probability of a rare event from a few hundred simulations.

The event is a set in the space of normal scores, z ~ N(0, I). Every batch takes the same three steps.

1. Surrogate. The flags of all runs so far give p(z), the probability that the event happens at z.
2. First phase, without runs: a pool of points z_j ~ h with weights w_j = phi(z_j) / h(z_j), where h follows
   the places that matter under the last surrogate, and in part a wide law.
3. Second phase, n runs taken out of the pool where w_j times the surrogate's error is large, and a defensive
   share of them anywhere. With p as control variate they give an estimate Y, E[Y | past] = P (`two_phase`).

The estimate is the mean of Y over the batches, weighted by what the surrogate foretold before a batch was
drawn: the weights depend on the past only, so that the weighted errors are a martingale. Until the first
event the surrogate learns the runs of smallest score instead, and the wide law is followed, not phi: nothing
tells in advance which variable is rare. Notebook 10 derives the method.
"""

import math
import os
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from threadpoolctl import ThreadpoolController

from accelerated_evaluation.distributions.protocol import Array
from accelerated_evaluation.errors import InputError
from accelerated_evaluation.files import write_json
from accelerated_evaluation.methods.surrogate.gaussian_process import EventSurrogate
from accelerated_evaluation.methods.surrogate.state import arrays, plain, read_state
from accelerated_evaluation.methods.surrogate.two_phase import (
    CORE,
    FLOOR,
    FRINGE_WEIGHT,
    account,
    aim,
    combine,
    counted,
    foretell,
    inclusion,
    systematic,
)
from accelerated_evaluation.methods.surrogate.wide_laws import (
    KernelMixture,
    bound_without_event,
    draw_wide,
    log_normal_to_wide,
)
from accelerated_evaluation.rare_event import RareEvent

BLAS = ThreadpoolController()  # one thread: the matrices are small, and bytes must not depend on the cores
FORMAT = "accelerated-evaluation sampler state"
START = 20  # runs of the wide law before the surrogate is asked
NEAREST = 5  # runs taken for the event while there is none
RELEARN = 1.3  # growth of the number of runs after which lengths and amplitude are learnt again
POOL, KERNELS, WIDE_SHARE = 2000, 200, 0.2
USABLE, AGREEMENT = 1.5, 1.5  # foretold coefficient of variation of a run, ratio of successive predictions


@dataclass(frozen=True)
class Target:
    """When to stop: a relative half-width of the 100 (1 - alpha) % interval, or that many simulations."""

    half_width: float = 0.2
    alpha: float = 0.2
    maximum_calls: int = 1000


@dataclass(frozen=True)
class Result:
    """What the runs so far say.

    Attributes
    ----------
    probability
        Estimate of P(event); 0 while no event was found, see ``event_found``, and NaN while the surrogate is
        not good enough for an estimate that could be trusted.
    ci_low, ci_high
        Interval of the target's confidence; without an event from 0 to the bound that holds for any event,
        without an estimate from 0 to 1.
    calls
        Simulations made, learning included.
    converged
        Whether the interval is as narrow as asked.
    event_found
        Whether any simulation ended in the event.
    state
        Everything that is needed to go on, as JSON has it.
    """

    probability: float
    ci_low: float
    ci_high: float
    calls: int
    converged: bool
    event_found: bool
    state: dict[str, Any]


def sample(
    event: RareEvent,
    target: Target,
    generator: np.random.Generator,
    batch_size: int = 10,
    *,
    state_file: str | os.PathLike | None = None,
    on_batch: Callable[[Result], None] = lambda _: None,
) -> Result:
    """Estimate P(event) by as few simulations as possible.

    Parameters
    ----------
    event
        Inputs and system.
    target
        When to stop.
    generator
        Source of all randomness.
    batch_size
        Simulations asked for at once.
    state_file
        Where the state is saved after every batch; if the file exists, its runs are taken up, not repeated.
        Keep one for each problem: that it belongs to this one is known by the number of variables alone.
    on_batch
        Told the result after every batch.

    Raises
    ------
    InputError
        If the state file is no sampler's, or of another number of variables.
    """
    if state_file is not None and Path(state_file).exists():
        sampler = Sampler.resume(read_state(state_file), dimension=event.dimension, where=str(state_file))
    else:
        sampler = Sampler(event.dimension, generator, batch_size)
    result = sampler.result(target)
    while not result.converged and result.calls + sampler.batch_size <= target.maximum_calls:
        sampler.tell(*event.evaluate(sampler.ask()))
        result = sampler.result(target)
        if state_file is not None:
            write_json(state_file, result.state)
        on_batch(result)
    return result


class Sampler:
    """Asks for batches of simulations and is told how they ended; for vehicles that are run elsewhere.

    Parameters
    ----------
    dimension
        Number d of normal scores.
    generator
        Source of all randomness.
    batch_size
        Number n of simulations asked for at once, up to a quarter of the pool.
    """

    def __init__(self, dimension: int, generator: np.random.Generator, batch_size: int = 10) -> None:
        if not 1 <= batch_size <= POOL // 4:
            raise ValueError(f"batch_size must be from 1 to {POOL // 4}, got {batch_size}")
        self._generator, self.batch_size = generator, batch_size
        self._surrogate = EventSurrogate(dimension)
        self.z, self.event, self.score = np.empty((0, dimension)), np.empty(0, bool), np.empty(0)
        self.batches: list[dict[str, Any]] = []
        self._pending: dict[str, Any] | None = None
        self._centres: Array | None = None
        self._level: float | None = None
        self._learnt_at, self._wide_runs, self._believed = 0, 0, 0.0

    def ask(self) -> Array:
        """Return the normal scores to simulate next, shape (n, d); the same until `tell`."""
        if self._pending is None:
            with BLAS.limit(limits=1):
                self._pending = self._design()
        return self._pending["z"]

    def tell(self, event: ArrayLike, score: ArrayLike | None = None) -> None:
        """Take the outcomes of the batch asked for last.

        Parameters
        ----------
        event
            Whether the event happened, shape (n,).
        score
            Falls as the event comes nearer, shape (n,); None where only the flag is known.
        """
        z = self.ask()
        batch, event = self._pending, np.asarray(event, dtype=bool)
        score = np.zeros(len(z)) if score is None else np.asarray(score, dtype=float)
        if event.shape != (len(z),) or score.shape != (len(z),):
            raise ValueError(f"asked for {len(z)} simulations, told of {event.shape} and {score.shape}")
        if np.isnan(score).any():
            raise ValueError("a score is not a number")
        self.z, self.event = np.vstack([self.z, z]), np.append(self.event, event)
        largest = np.finfo(float).max  # JSON has no infinity
        self.score = np.append(self.score, np.clip(score, -largest, largest))
        self._wide_runs += len(z) if batch.get("wide") else 0
        self._pending = None
        if "weight" in batch:
            self.batches.append(account(batch, event))

    def result(self, target: Target) -> Result:
        """Return the estimate from the batches since the surrogate became usable."""
        if not self.event.any():
            bound = bound_without_event(self._wide_runs, target.alpha)
            return Result(0.0, 0.0, bound, len(self.z), False, False, self.state())
        batches = counted(self.batches)
        probability, half_width = combine(batches, target.alpha) if len(batches) > 1 else (0.0, 0.0)
        if not (probability > 0 and half_width > 0):
            return Result(math.nan, 0.0, 1.0, len(self.z), False, True, self.state())
        interval = max(probability - half_width, 0.0), min(probability + half_width, 1.0)
        converged = half_width <= target.half_width * probability
        return Result(probability, *interval, len(self.z), converged, True, self.state())

    def _design(self) -> dict[str, Any]:
        level = target = None
        if len(self.z) >= START:
            level = None if self.event.any() else float(np.sort(self.score)[NEAREST - 1])
            target = self.event if level is None else self.score <= level
        if target is None or target.all():  # the beginning; or flags alone and no event
            return {"z": draw_wide(self.batch_size, self.z.shape[1], self._generator), "wide": True}
        restart, self._level = level != self._level or self._learnt_at == 0, level
        learn = restart or len(self.z) >= RELEARN * self._learnt_at
        self._learnt_at = len(self.z) if learn else self._learnt_at
        self._surrogate.fit(self.z, target, learn=learn, restart=restart)
        return self._second_phase() if level is None else {"z": self._approach()}

    def _approach(self) -> Array:
        """Points of the wide law where the runs of smallest score lead to expect more of them."""
        z = draw_wide(POOL // 2, self.z.shape[1], self._generator)
        share = self._surrogate.probability(z) ** 2
        return z[self._generator.choice(len(z), self.batch_size, replace=False, p=share / share.sum())]

    def _pool(self, size: int) -> tuple[Array, Array, Array]:
        """Points of the first phase, shape (m, d), their weights phi / h, and p."""
        if self._centres is None:
            z = draw_wide(size, self.z.shape[1], self._generator)
            log_weight = log_normal_to_wide(z)
        else:
            law = KernelMixture.about(self._centres, WIDE_SHARE)
            z = law.draw(size, self._generator)
            log_weight = law.log_normal_ratio(z)
        return z, np.exp(log_weight), self._surrogate.probability(z)

    def _second_phase(self) -> dict[str, Any]:
        # A pool of its own says where to draw, how far the fringe goes, and what the batch will be worth:
        # nothing of the batch's own pool may enter.
        limit = 0.0
        for _ in range(1 if self._centres is not None else 2):
            z, w, p = self._pool(POOL // 2)
            core = np.where(p >= CORE, p, 0.0)
            if not core.any():
                break
            limit = FRINGE_WEIGHT * (w @ (w * core)) / (w * core).sum()
            share = w * np.sqrt(core)
            self._centres = z[self._generator.choice(len(z), KERNELS, p=share / share.sum())]
        believed, foretold = foretell(w, *aim(w, p, limit), self.batch_size, POOL)
        ratio = believed / self._believed if self._believed else 0.0
        usable, self._believed = foretold < USABLE**2 and 1 / AGREEMENT < ratio < AGREEMENT, believed

        z, w, p = self._pool(POOL)
        p, g, error = aim(w, p, limit)
        pi = inclusion(w * np.sqrt(error + FLOOR * p), self.batch_size)
        chosen = systematic(z, w * np.sqrt(p), pi, self._generator)
        w = w / POOL
        return {
            "z": z[chosen], "w": w[chosen], "g": g[chosen], "pi": pi[chosen],
            "controlled": float(w @ g), "controlled_square": float(w * w @ g),
            "weight": self.batch_size / max(foretold, USABLE**2), "foretold": foretold / self.batch_size,
            "usable": bool(usable),
        }  # fmt: skip

    def state(self) -> dict[str, Any]:
        """Return everything that is needed to go on, as JSON has it; `resume` takes it up."""
        own = {name: value for name, value in vars(self).items() if name not in ("_generator", "_surrogate")}
        learnt = {"theta": self._surrogate.theta, "sites": self._surrogate.sites}
        return plain({"format": FORMAT} | own | learnt | {"generator": self._generator.bit_generator.state})

    @classmethod
    def resume(cls, state: Mapping[str, Any], *, dimension: int, where: str = "sampler state") -> "Sampler":
        """Return the sampler of a state; ``dimension`` and ``where`` are for the check and its message.

        Raises
        ------
        InputError
            If the state is no sampler's, or of another number of variables.
        """
        try:
            if state["format"] != FORMAT or len(state["theta"]) != dimension + 1:
                raise ValueError(f"format {state['format']!r}, {len(state['theta']) - 1} variables")
            bits = getattr(np.random, state["generator"]["bit_generator"])()
            bits.state = state["generator"]
            sampler = cls(dimension, np.random.Generator(bits), state["batch_size"])
            for name in set(vars(sampler)) - {"_generator", "_surrogate"}:
                setattr(sampler, name, arrays(state[name]) if name != "batches" else state[name])
            sampler.z = sampler.z.reshape(-1, dimension)
            sampler.event = sampler.event.astype(bool)
            surrogate = sampler._surrogate
            surrogate.theta, surrogate.sites = map(np.array, (state["theta"], state["sites"]))
        except (AttributeError, KeyError, TypeError, ValueError) as error:
            raise InputError(
                where,
                seen=f"{type(error).__name__}: {error}",
                expected=f"format {FORMAT!r}, {dimension} variables",
                change="Give the state file of this problem, or a path where there is no file yet.",
            ) from None
        return sampler
