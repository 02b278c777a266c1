"""The probability to which all methods are held: known, or by importance sampling, 8 million simulations.

None of the compared methods is used. A pilot draws from a wide radial law: every direction alike, and
-log P(|Z| > radius) uniform, so that events of any probability down to exp(-REACH) are met. The final law is
a Gaussian kernel around pilot events taken by their weights, with a tenth of the wide law; all its draws are
fresh.
"""

import argparse
import math

import numpy as np
from accelerated_evaluation.base.arrays import Array
from accelerated_evaluation.base.files import write_json
from accelerated_evaluation.base.randomness import child_generator
from fewruns import ScoreProblem
from problems import problems
from scipy.spatial.distance import cdist
from scipy.stats import chi2

REACH = 80.0
WIDE = 0.1  # share of the wide law in the final one
KERNELS = 200
BATCH = 250_000
PILOT, FINAL = 16, 16  # batches: 4 and 4 million simulations


def draw_wide(generator: np.random.Generator, size: int, dimension: int) -> Array:
    """Draw from the wide radial law, shape (size, dimension)."""
    radius = np.sqrt(chi2.isf(np.exp(-generator.uniform(0, REACH, size)), dimension))
    z = generator.standard_normal((size, dimension))
    return z * (radius / np.linalg.norm(z, axis=1))[:, None]


def log_ratio_wide(z: Array) -> Array:
    """Log of the normal density over that of the wide law; +inf beyond its reach."""
    tail = chi2.logsf(np.square(z).sum(axis=1), z.shape[1])
    return np.where(tail >= -REACH, tail + math.log(REACH), math.inf)


def log_normal(z: Array) -> Array:
    """Log density of independent standard normals."""
    return -0.5 * np.square(z).sum(axis=1) - z.shape[1] / 2 * math.log(2 * math.pi)


def log_kernels(z: Array, centres: Array, width: Array) -> Array:
    """Log density of the Gaussian kernels, shape (n,)."""
    parts = np.array_split(z / width, len(z) // 5000 + 1)
    mean = [np.exp(-0.5 * cdist(part, centres / width, "sqeuclidean")).mean(axis=1) for part in parts]
    constant = len(width) / 2 * math.log(2 * math.pi) + np.log(width).sum()
    with np.errstate(divide="ignore"):  # far from all kernels; the wide law is there
        return np.log(np.concatenate(mean)) - constant


def pilot(event: ScoreProblem, generator: np.random.Generator) -> tuple[Array, Array]:
    """Return events of the wide law with their weights, shapes (n, d) and (n,)."""
    met = []
    for _ in range(PILOT):
        z = draw_wide(generator, BATCH, event.dimension)
        met.append(z[event.evaluate(z)[0]])
    z = np.concatenate(met)
    return z, np.exp(log_ratio_wide(z))


def reference(event: ScoreProblem, generator: np.random.Generator) -> tuple[float, float]:
    """Return the probability of an event and its standard error."""
    z, weight = pilot(event, generator)
    centres = z[generator.choice(len(z), KERNELS, p=weight / weight.sum())]
    # Silverman's rule, once for every variable.
    width = np.maximum(centres.std(axis=0), 0.05) * KERNELS ** (-1 / (event.dimension + 4))
    means = []
    for _ in range(FINAL):
        z = centres[generator.integers(KERNELS, size=BATCH)]
        z = z + width * generator.standard_normal(z.shape)
        wide = generator.random(BATCH) < WIDE
        z[wide] = draw_wide(generator, int(wide.sum()), event.dimension)
        z = z[event.evaluate(z)[0]]
        normal = log_normal(z)
        parts = (
            math.log(WIDE) + normal - log_ratio_wide(z),
            math.log1p(-WIDE) + log_kernels(z, centres, width),
        )
        means.append(np.exp(normal - np.logaddexp(*parts)).sum() / BATCH)
    return float(np.mean(means)), float(np.std(means, ddof=1) / math.sqrt(FINAL))


def main() -> None:
    """Write the probability of one problem and its standard error."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("problem")
    parser.add_argument("--output", required=True)
    arguments = parser.parse_args()
    problem = problems()[arguments.problem]
    if problem.exact is not None:
        probability, error = problem.exact, 0.0
    else:
        probability, error = reference(problem.event, child_generator(2016, "reference", problem.name))
    write_json(arguments.output, {"probability": probability, "standard_error": error})


if __name__ == "__main__":
    main()
