"""What the tests of the sampler share: half planes as events, and a sampler that is driven step by step."""

import json
from dataclasses import dataclass

import numpy as np
from fewruns import Sampler, Stopping, SystemProblem, two_phase
from fewruns.running import estimate_problem
from fewruns.state import content_of, sampler_of
from scipy.stats import norm

STOPPING = Stopping(alpha=0.2, beta=0.2, minimum_events=1, maximum_simulations=1000)
HALF_PLANE = norm.sf(4.0)


def standard_normal_event(margin, *, graded=True, dimension=2):
    """Return the event that a margin, a function of z, is negative."""

    def respond(z):
        score = margin(z)
        return score < 0, score if graded else None

    return SystemProblem(respond, dimension, fingerprint="half planes", deterministic=True)


def half_plane(level=4.0, *, graded=True):
    return standard_normal_event(lambda z: level - z @ [0.6, 0.8], graded=graded)


@dataclass
class Course:
    """What a test keeps of a whole run: the estimate, the sampler, and two estimates that must be wrong."""

    result: object
    sampler: Sampler
    flags: float
    twice_controlled: float


def new_sampler(dimension=2, seed=0, batch_size=10, *, deterministic=True, **settings):
    settings |= {"deterministic": deterministic, "fingerprint": "half planes"}
    return Sampler(dimension, np.random.default_rng(seed), batch_size, **settings)


def drive(sampler, event, stopping=STOPPING):
    """Run a sampler to the end, as the method does."""
    flags, twice = [], []
    while not sampler.is_done(stopping):
        z = sampler.ask(certify=sampler.is_narrow(stopping))
        assert 0 < len(z) <= sampler.batch_size
        batch = sampler.progress.pending
        happened, score = event.evaluate(z)
        sampler.tell(happened, score)
        if isinstance(batch, two_phase.TwoPhaseBatch) and batch.weight.any():  # not of a cover
            flags.append(happened.mean())
            twice.append(batch.controlled + (batch.weight * happened / batch.inclusion).sum())
    counted = -len(sampler.progress.sampled)
    return Course(sampler.estimate(stopping), sampler, np.mean(flags[counted:]), np.mean(twice[counted:]))


def estimate(event, seed, stopping=STOPPING, **settings):
    return estimate_problem(event, np.random.default_rng(seed), stopping, **settings)


def courses(event, seeds, batch_size=10):
    return [drive(new_sampler(event.dimension, seed, batch_size), event) for seed in range(seeds)]


def numbers(result):
    return result.probability, result.low, result.high, result.simulations, result.converged


def saved(sampler):
    """Return the content of the state file of a sampler."""
    return json.loads(json.dumps(content_of(sampler), allow_nan=False))


def resumed(sampler):
    """Return the sampler that continues from the state of another."""
    return sampler_of(saved(sampler), "a test")
