"""Time and memory of every rule, as a finished study measured them, and what a cluster is asked for by them.

Run as ``python benchmarks/rules.py results/spmd results/left_turn`` it writes the table of measurements,
``benchmarks/results/rules.csv``, and from it the end of ``profiles/slurm/config.yaml``; without the folder of
a study only the latter. What was measured on other studies is kept. Each rule is asked for by the study in
which its jobs took longest.
"""

import argparse
import math
import re
from collections.abc import Iterable, Iterator
from pathlib import Path

import pandas as pd
from accelerated_evaluation.base.errors import InputError
from accelerated_evaluation.base.files import write_csv, write_text

ROOT = Path(__file__).resolve().parents[1]
MEASURED = ROOT / "benchmarks" / "results" / "rules.csv"
PROFILE = ROOT / "profiles" / "slurm" / "config.yaml"
MARK = "# The rest is made from benchmarks/results/rules.csv by python benchmarks/rules.py.\n"
MARGIN = 10  # times the measured seconds: another study has more records, another node a slower processor
LEAST_MINUTES = 5
MEMORY_MARGIN = 2  # times the measured memory
MEMORY_STEP = 500  # [MB], to which requests are rounded up


def measure(results: Path) -> pd.DataFrame:
    """Return what the jobs of every rule of a finished study took.

    Seconds are of a processor at work,
    because the time on the clock would count what else the machine did.

    Parameters
    ----------
    results
        Folder of the results of the study; the crash maps of its vehicles are beside it.

    Returns
    -------
    pandas.DataFrame
        A row for each rule: the number of its jobs, the seconds of the longest and of all, the largest memory
        [MB], and on what that was measured.

    Raises
    ------
    InputError
        If the folder holds no results.
    """
    paths = [*results.glob("benchmarks/**/*.tsv"), *results.parent.glob("vehicles/*/benchmarks/*.tsv")]
    if not results.joinpath("benchmarks").is_dir():
        raise InputError(
            str(results / "benchmarks"),
            seen="no such folder",
            expected="the benchmarks of a finished study",
            change="Run the study, or correct the path.",
        )
    jobs = pd.concat([pd.read_csv(path, sep="\t").assign(rule=rule_of(path)) for path in sorted(paths)])
    jobs["seconds"] = jobs["s"] * jobs["mean_load"] / 100
    by_rule = jobs.groupby("rule")
    table = by_rule["seconds"].agg(jobs="size", seconds_longest="max", seconds_all="sum")
    table = table.assign(memory_mb=by_rule["max_rss"].max()).round(1).reset_index()
    return table.assign(study=results.name, processor=_processor())


def longest(tables: Iterable[pd.DataFrame]) -> pd.DataFrame:
    """Return a row for each rule: that of the study in which its longest job took most."""
    together = pd.concat(tables).sort_values("seconds_longest", kind="stable")
    return together.drop_duplicates("rule", keep="last").sort_values("rule").reset_index(drop=True)


def rule_of(benchmark: Path) -> str:
    """Return the rule that a benchmark belongs to, by its path below the folder benchmarks."""
    folder = benchmark.parts[benchmark.parts.index("benchmarks") + 1]
    return f"run_{benchmark.stem}" if folder == "notebooks" else folder.removesuffix(".tsv")


def requests(measured: pd.DataFrame) -> Iterator[str]:
    """Yield the requests for time [min] and memory [MB] of each rule, doubled at a second attempt."""
    for row in measured.itertuples():
        minutes = max(math.ceil(MARGIN * row.seconds_longest / 60), LEAST_MINUTES)
        memory = MEMORY_STEP * math.ceil(MEMORY_MARGIN * row.memory_mb / MEMORY_STEP)
        yield f"  {row.rule}: {{runtime: {minutes} * attempt, mem_mb: {memory} * attempt}}\n"


def profile(text: str, measured: pd.DataFrame) -> str:
    """Return the text of a profile with the requests for its rules at its end."""
    return f"{text.split(MARK)[0]}{MARK}set-resources:\n{''.join(requests(measured))}"


def _processor() -> str:
    """Return the name of the processor, as Linux reports it."""
    cpu = Path("/proc/cpuinfo")
    names = re.findall(r"^model name\s*: (.*)$", cpu.read_text() if cpu.is_file() else "", re.MULTILINE)
    return names[0] if names else "not known"


def main() -> None:
    """Write the table and the profile."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("results", nargs="*", type=Path, help="results of finished studies, as results/spmd")
    if studies := parser.parse_args().results:
        known = pd.read_csv(MEASURED)
        others = known[~known["study"].isin([study.name for study in studies])]
        write_csv(MEASURED, longest([others, *map(measure, studies)]))
    write_text(PROFILE, profile(PROFILE.read_text(encoding="utf-8"), pd.read_csv(MEASURED)))


if __name__ == "__main__":
    main()
