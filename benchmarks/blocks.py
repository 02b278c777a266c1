"""Tables in Markdown texts, each between two comment lines, which are filled from CSV files."""

import re
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import NamedTuple

import pandas as pd
from accelerated_evaluation.base.files import write_text

ROOT = Path(__file__).resolve().parents[1]
RESULTS = ROOT / "benchmarks" / "results"
NOTHING = "–"
MISSING = re.compile(r"\bnan\b")


class Block(NamedTuple):
    """A table in a Markdown text."""

    text: Path
    source: Path  # CSV file
    make: Callable[[pd.DataFrame], str]  # returns the table in Markdown

    def marks(self, name: str) -> tuple[str, str]:
        """Return the two comment lines that enclose the table."""
        origin = f"made from {self.source.parent.relative_to(ROOT).as_posix()} by python benchmarks/readme.py"
        return f"<!-- {name}: {origin} -->\n", f"<!-- end of {name} -->\n"


def markdown(headings: tuple[str, ...], rows: list[tuple[str, ...]]) -> str:
    """Return a Markdown table with the given headings and rows of text, in which 80% is written 80 %."""
    lines = [headings, ("---",) * len(headings), *rows]
    table = "".join(f"| {' | '.join(cells)} |\n".replace("|  |", "| |") for cells in lines)
    return re.sub(r"(?<=\d)%", " %", table)


def formatted(table: pd.DataFrame, cells: Mapping[str, str]) -> str:
    """Return a Markdown table with the given headings, and a row for each row of a table.

    ``cells`` maps each heading to the format of its cells, for example ``"{runs:,.0f}"`` for the column
    ``runs``. A cell whose value is missing contains a dash.
    """
    rows = [
        tuple(NOTHING if MISSING.search(cell := form.format_map(row)) else cell for form in cells.values())
        for row in table.to_dict("records")
    ]
    return markdown(tuple(cells), rows)


def with_table(text: str, name: str, block: Block, content: str) -> str:
    """Return a text in which the content of a block is replaced."""
    begin, end = block.marks(name)
    before, rest = text.split(begin)
    return before + begin + content + end + rest.split(end)[1]


def with_tables(path: Path, blocks: Mapping[str, Block]) -> str:
    """Return the text of a file with all its tables made from the CSV files again."""
    text = path.read_text(encoding="utf-8")
    for name, block in blocks.items():
        if block.text == path:
            text = with_table(text, name, block, block.make(pd.read_csv(block.source)))
    return text


def update(blocks: Mapping[str, Block]) -> None:
    """Fill all blocks in their files."""
    for path in dict.fromkeys(block.text for block in blocks.values()):
        write_text(path, with_tables(path, blocks))
