"""Tables of results in Markdown texts, made from published tables; this module has those of the README.

``python -m accelerated_evaluation.publishing.readme`` updates them. Those of the benchmarks are in
``benchmarks/readme.py``.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

import pandas as pd

from accelerated_evaluation.base.files import write_text
from accelerated_evaluation.publishing.tables.paper_numbers import PAPER_PROBABILITY

ROOT = Path(__file__).resolve().parents[3]
ANSWER = ROOT / "figures" / "spmd" / "tables" / "answer.csv"
CLAIMS = ROOT / "figures" / "spmd" / "tables" / "claims.csv"
WORLDS = ROOT / "benchmarks" / "results" / "worlds.csv"
WORLDS_BEYOND = ROOT / "benchmarks" / "results" / "worlds_beyond.csv"
CAUSES = ROOT / "benchmarks" / "results" / "worlds_causes.csv"
MOTORWAY = ROOT / "benchmarks" / "results" / "motorway.csv"
MOTORWAY_CHAIN = ROOT / "benchmarks" / "results" / "motorway_chain.csv"
README = ROOT / "README.md"
COMMAND = "python -m accelerated_evaluation.publishing.readme"
SHOWN = (
    "crash probability of one lane change",
    "simulations to converge, piecewise, mean",
    "simulations to converge, single, mean",
    "single / piecewise",
    "simulations to converge, crude Monte Carlo",
    "crude / piecewise",
    "fitted parameters, piecewise",
)
PAPER_INTERVAL = "7e-07 to 7.8e-07, of the simulations alone"  # section VI.C, 80 %


def answers_table(answer: pd.DataFrame) -> str:
    """Return a Markdown table of the crash probability with its intervals, and of the paper's numbers.

    Parameters
    ----------
    answer
        Published table ``answer.csv``.
    """
    crash = answer.set_index("event").loc["crash"]
    rows = [("crash of a cut-in, median", _number(PAPER_PROBABILITY), f"**{crash['median']:.1e}**")]
    for level in (50, 80, 95):
        ends = f"{crash[f'low{level}']:.1e} to {crash[f'high{level}']:.1e}"
        rows.append((f"{level} % interval", PAPER_INTERVAL if level == 80 else "–", ends))
    rows.append(("mean", "–", f"{crash['probability']:.1e}"))
    return markdown(("", "paper", "this project"), rows)


def results_table(claims: pd.DataFrame) -> str:
    """Return a Markdown table of the claims `SHOWN`: the paper's number, ours, its spread and the verdict.

    Parameters
    ----------
    claims
        Published table ``claims.csv``.
    """
    rows = []
    for claim, row in claims.set_index("claim").loc[list(SHOWN)].iterrows():
        spread = f"{_number(row.ours_low)} to {_number(row.ours_high)} ({row.spread})"
        rows.append((claim, _number(row.paper), _number(row.ours), spread, row.verdict))
    return markdown(("", "paper", "ours", "our spread", "verdict"), rows)


def markdown(headings: tuple[str, ...], rows: list[tuple[str, ...]]) -> str:
    """Return a Markdown table with the given headings and rows of text."""
    lines = [headings, ("---",) * len(headings), *rows]
    return "".join(f"| {' | '.join(cells)} |\n".replace("|  |", "| |") for cells in lines)


@dataclass(frozen=True)
class Table:
    """A table in a Markdown text.

    Attributes
    ----------
    text
        File with the text.
    source
        File with the published table, from which the Markdown table is made.
    make
        Function that makes the Markdown table.
    command
        Command that updates the table, for a comment in the text.
    """

    text: Path
    source: Path
    make: Callable[[pd.DataFrame], str]
    command: str = COMMAND

    def marks(self, name: str) -> tuple[str, str]:
        """Return the two comment lines that enclose the table in its text."""
        origin = f"made from {self.source.parent.relative_to(ROOT).as_posix()} by {self.command}"
        return f"<!-- {name}: {origin} -->\n", f"<!-- end of {name} -->\n"


TABLES = {
    "answer": Table(README, ANSWER, answers_table),
    "results": Table(README, CLAIMS, results_table),
}


def with_table(text: str, name: str, content: str, tables: Mapping[str, Table] = TABLES) -> str:
    """Return a text in which one table is replaced.

    Parameters
    ----------
    text
        Text with the comment lines that enclose the table.
    name
        Name of the table in ``tables``.
    content
        New table in Markdown.
    tables
        All tables, by name.
    """
    begin, end = tables[name].marks(name)
    before, rest = text.split(begin)
    return before + begin + content + end + rest.split(end)[1]


def with_tables(path: Path, tables: Mapping[str, Table] = TABLES) -> str:
    """Return the text of a file with all its tables regenerated from the published tables."""
    text = path.read_text(encoding="utf-8")
    for name, table in tables.items():
        if table.text == path:
            text = with_table(text, name, table.make(pd.read_csv(table.source)), tables)
    return text


def _number(value: float) -> str:
    return f"{value:,.0f}" if 10 <= value < 1e6 else f"{value:.3g}"


def update(tables: Mapping[str, Table] = TABLES) -> None:
    """Replace all given tables in their files by new ones from the published tables."""
    for path in dict.fromkeys(table.text for table in tables.values()):
        write_text(path, with_tables(path, tables))


if __name__ == "__main__":
    update()
