"""Random generators: one root seed, and an independent child generator for every piece of random work."""

import zlib
from typing import Any

import numpy as np

from accelerated_evaluation.base.arguments import Argument, a_number
from accelerated_evaluation.base.checking import checked

A_SEED = a_number(0, whole=True)
A_PART = Argument(
    "texts, and whole numbers of 0 or more",
    lambda part: zlib.crc32(part.encode()) if isinstance(part, str) else A_SEED.take(part),
)


@checked(root_seed=A_SEED)
def child_generator(root_seed: int, *path: str | int) -> np.random.Generator:
    """Return the random generator for one piece of work.

    The path names the work, for example by stage, method, segment, seed and replicate. The same root seed and
    path always give the same random numbers, whatever other work is done, in any order and on any number of
    cores.

    Parameters
    ----------
    root_seed
        Seed of the study.
    path
        Names and numbers that identify the piece of work.

    Returns
    -------
    numpy.random.Generator
        A generator that is independent of those of all other paths.

    Examples
    --------
    >>> import accelerated_evaluation as ae
    >>> first, again = (ae.child_generator(7, "fit", 3).random() for _ in range(2))
    >>> first == again != ae.child_generator(7, "fit", 4).random()
    True
    """
    key = tuple(A_PART.of(part, "child_generator, argument path") for part in path)
    return np.random.default_rng(np.random.SeedSequence(root_seed, spawn_key=key))


def _generator(value: Any) -> np.random.Generator:  # noqa: ANN401
    return value if isinstance(value, np.random.Generator) else child_generator(A_SEED.take(value))


A_GENERATOR = Argument(
    "a numpy.random.Generator, or a whole number of 0 or more as its seed",
    _generator,
    "Write, for example, generator=1.",
)
DRAWING = {"n": a_number(0, 10**8, whole=True), "generator": A_GENERATOR}  # arguments of methods that draw
