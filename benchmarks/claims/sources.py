"""Where published tables and those of the short repetition are."""

from dataclasses import dataclass
from pathlib import Path

import pandas as pd
from accelerated_evaluation.base.errors import InputError

ROOT = Path(__file__).resolve().parents[2]


@dataclass(frozen=True)
class Files:
    """Where published and repeated tables are.

    Attributes
    ----------
    tables, benchmarks
        Published tables of the study, and of the benchmarks.
    study, raw
        Results of the repeated study, and of the repeated benchmarks.
    """

    tables: Path = ROOT / "figures" / "spmd" / "tables"
    benchmarks: Path = ROOT / "benchmarks" / "results"
    study: Path = Path("results/claims")
    raw: Path = Path("results/benchmarks/claims")

    def pair(self, path: str) -> list[pd.DataFrame]:
        """Return the published table of a study, and the repeated one, which has this path in its results."""
        return [pd.read_csv(each) for each in (self.tables / Path(path).name, self.study / path)]

    def runs(self, name: str) -> pd.DataFrame:
        """Return all runs of a benchmark; they are in several files.

        Raises
        ------
        InputError
            If there are none.
        """
        paths = sorted(self.raw.glob(f"{name}*.csv"))
        if not paths:
            raise InputError(
                str(self.raw / f"{name}*.csv"),
                seen="no such file",
                expected="the runs of the short repetition",
                change="Let it run to its end.",
            )
        return pd.concat(map(pd.read_csv, paths), ignore_index=True)


FILES = Files()
