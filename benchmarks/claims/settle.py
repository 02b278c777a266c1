"""Compare what the short repetition found with what is published: a table with a verdict for each claim.

    python benchmarks/claims/settle.py [PART ...]

The exit status is 1 if a claim is refuted. What is published is read from ``figures/spmd/tables`` and
``benchmarks/results``, from which the tables of the README are made.
"""

import argparse
import sys
from collections.abc import Callable, Iterable, Iterator, Sequence

import pandas as pd
from accelerated_evaluation.base.errors import InputError
from accelerated_evaluation.base.files import write_csv
from comparing import LEVEL, Claim
from of_benchmarks import estimate, public, sampler, successor, vehicle, worlds
from of_study import answer, counted, injuries, motion, paper, scenarios
from sources import FILES, Files

PARTS: dict[str, Callable[[Files], Iterator[Claim]]] = {
    part.__name__: part
    for part in (
        vehicle,
        paper,
        answer,
        counted,
        motion,
        injuries,
        worlds,
        sampler,
        public,
        successor,
        estimate,
        scenarios,
    )
}
# Claims of the README that no part repeats, and why.
NOT_REPEATED = {
    "running times of the study, the tests and the installation": "they depend on the machine",
    "statements of the paper in words": "`make study` judges them (chapter 8)",
    "coverage in worlds that break an assumption of the models": "`make worlds` repeats it, in two hours",
    "shares of the answer beyond the records, and the replayed records": "`make study` computes them",
    "crashes counted on a simulated motorway": "`make world` repeats them, in an hour",
}


def settle(files: Files, parts: Iterable[str] = PARTS) -> pd.DataFrame:
    """Return a table with a row for each claim: part, claim, published, found, p_value, verdict."""
    rows = [
        {
            "part": f"{list(PARTS).index(part) + 1} {part}",
            "claim": claim.text,
            "published": str(claim.published),
            "found": str(claim.found),
            "p_value": f"{claim.likelihood:.2g}",
            "verdict": claim.verdict,
        }
        for part in parts
        for claim in PARTS[part](files)
    ]
    return pd.DataFrame(rows)


def main(arguments: Sequence[str] | None = None, files: Files = FILES) -> int:
    """Print the table, write it to ``claims.csv``, and return the exit status: 1 if a claim is refuted."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("parts", nargs="*", metavar="PART", help=f"of {', '.join(PARTS)}; all by default")
    asked = parser.parse_args(arguments).parts or list(PARTS)
    if unknown := [part for part in asked if part not in PARTS]:
        parser.error(f"unknown part {unknown[0]}; expected some of {', '.join(PARTS)}")
    try:
        table = settle(files, asked)
    except (InputError, FileNotFoundError) as error:
        print(f"error: {error}\nMake what is missing with: make claims", file=sys.stderr)
        return 2
    write_csv(files.raw / "claims.csv", table)
    print(table.to_markdown(index=False, disable_numparse=True))
    refuted = int((table["verdict"] == "refuted").sum())
    print(f"\n{len(table)} claims, {refuted} refuted (p < {LEVEL}).\n\nNot repeated:")
    print(*(f"- {claim}: {why}" for claim, why in NOT_REPEATED.items()), sep="\n")
    return int(refuted > 0)


if __name__ == "__main__":
    sys.exit(main())
