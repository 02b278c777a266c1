"""One root seed, and a child of its own for every piece of random work."""

import zlib

import numpy as np


def child_generator(root_seed: int, *path: str | int) -> np.random.Generator:
    """Return the generator of one piece of work, named by stage, method, segment, seed and replicate.

    The same names give the same numbers, whatever else runs, in whatever order, on however many cores.
    """
    key = tuple(part if isinstance(part, int) else zlib.crc32(part.encode()) for part in path)
    return np.random.default_rng(np.random.SeedSequence(root_seed, spawn_key=key))
