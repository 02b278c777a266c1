"""Certificates of the sampler: what each costs, and how often it is given though something is missing.

    python fewruns/benchmarks/certificate.py benchmarks/results/certificates.csv [--seeds 20]

The price is measured on two problems in which nothing is hidden. The honesty is measured on a half-space that
the scores lead to, with a second part of the event opposite, which no score points to. That part is the one
that the certificate speaks of: its design point is a little nearer than what a certified estimate excludes,
and it is as small as its curvature allows.
"""

import argparse
import math
from collections.abc import Iterator
from pathlib import Path

import pandas as pd
from accelerated_evaluation.base.arrays import Array
from accelerated_evaluation.base.files import write_csv
from accelerated_evaluation.base.randomness import child_generator
from accelerated_evaluation.publishing.tables.display import reproducible
from fewruns import Certificate, ScoreProblem, SystemProblem
from fewruns.certificate import BY_DEFAULT
from fewruns.running import estimate_problem
from methods import Target
from problems import problems
from reference import reference
from scipy.stats import norm
from tqdm import tqdm

ROOT = 2016
TARGET = Target(minimum_events=1, maximum_simulations=2000)
CERTIFICATES = (
    BY_DEFAULT,
    Certificate(share=1.0, curvature=0.0),
    Certificate(share=1.0, curvature=0.2),
    Certificate(share=0.1, curvature=0.0),
)
PRICED = ("segment_5_15", "range_1")
KNOWN = 4.5  # distance of the half-space that the scores lead to
BEYOND_THE_BOUND = 1.2  # so much more probable than what a certificate excludes the hidden part is


def hidden_part(z: Array, certificate: Certificate) -> Array:
    """Return where the hidden part is, shape (n,): a ball that touches a plane, or all beyond the plane."""
    excluded = BEYOND_THE_BOUND * certificate.share * norm.sf(KNOWN)
    depth = -z[:, 0] - norm.isf(excluded)  # behind the plane
    from_design_point = depth**2 + (z[:, 1:] ** 2).sum(1)
    return depth >= certificate.curvature * from_design_point / 2


def with_a_hidden_part(certificate: Certificate) -> ScoreProblem:
    """Return the event of two parts in three dimensions; its score knows the first part alone."""

    def respond(z: Array) -> tuple[Array, Array]:
        margin = KNOWN - z[:, 0]
        return (margin < 0) | hidden_part(z, certificate), margin

    return SystemProblem(respond, 3, fingerprint=f"hidden part, {certificate}")


def estimates(
    event: ScoreProblem, name: str, certificate: Certificate, seeds: int, bar: tqdm
) -> Iterator[dict[str, float]]:
    """Yield what each seed gave.

    Parameters
    ----------
    event, name
        The problem; its name begins the random numbers.
    certificate
        That must be met.
    seeds
        How many.
    bar
        Shows the progress.
    """
    for seed in range(seeds):
        generator = child_generator(ROOT, "certificate", name, seed)
        found = estimate_problem(event, generator, TARGET, certificate=certificate)
        met = hidden_part(pd.DataFrame(found.tables["runs"]).filter(like="z_").to_numpy(), certificate).any()
        yield {
            "probability": found.probability,
            "calls": found.simulations,
            "wide_draws": found.diagnostics["wide_draws"],
            "certified": found.converged,
            "missed": found.converged and not met,
        }
        bar.update()


def row(name: str, certificate: Certificate, seen: pd.DataFrame, truth: float | None) -> dict[str, object]:
    """Return a row of the table.

    Parameters
    ----------
    name, certificate
        Of the problem, and what was asked of its estimates.
    seen
        A row a seed.
    truth
        The probability of the event; None for an event with a hidden part, of which is said how often it was
        missed.
    """
    error = math.nan if truth is None else math.sqrt((seen["probability"] / truth - 1).pow(2).mean())
    return {
        "problem": name,
        "share": certificate.share,
        "curvature": certificate.curvature,
        "seeds": len(seen),
        "calls_mean": seen["calls"].mean(),
        "calls_p95": seen["calls"].quantile(0.95),
        "wide_draws": seen["wide_draws"].mean(),
        "certified": seen["certified"].mean(),
        "error": error,
        "missed": seen["missed"].mean() if truth is None else math.nan,
    }


def main() -> None:
    """Write the table."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("output", type=Path, help="where to write the table")
    parser.add_argument("--seeds", type=int, default=20, help="of each price; default: 20")
    parser.add_argument("--hidden-seeds", type=int, default=100, help="with a hidden part; default: 100")
    arguments = parser.parse_args()
    priced = {name: problems()[name].event for name in PRICED}
    sources = {name: child_generator(ROOT, "reference", name) for name in PRICED}
    truth = {name: reference(event, sources[name])[0] for name, event in priced.items()}
    each = len(PRICED) * arguments.seeds + arguments.hidden_seeds
    rows = []
    with tqdm(total=len(CERTIFICATES) * each, desc="estimates") as bar:
        for certificate in CERTIFICATES:
            for name, event in priced.items():
                seen = pd.DataFrame(estimates(event, name, certificate, arguments.seeds, bar))
                rows.append(row(name, certificate, seen, truth[name]))
            event = with_a_hidden_part(certificate)
            seen = pd.DataFrame(estimates(event, "hidden", certificate, arguments.hidden_seeds, bar))
            rows.append(row("hidden", certificate, seen, None))
    write_csv(arguments.output, reproducible(pd.DataFrame(rows)))


if __name__ == "__main__":
    main()
