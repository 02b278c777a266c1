"""Tables as CSV, Markdown and LaTeX."""

import os
from pathlib import Path

import pandas as pd

from accelerated_evaluation.files import write_csv, write_text


def save_table(table: pd.DataFrame, folder: str | os.PathLike, name: str) -> pd.DataFrame:
    """Save a table as ``folder/name`` with the endings csv, md and tex; return it for display."""
    write_csv(Path(folder) / f"{name}.csv", table)
    write_text(Path(folder) / f"{name}.md", table.to_markdown(index=False, disable_numparse=True) + "\n")
    write_text(Path(folder) / f"{name}.tex", table.to_latex(index=False, escape=True))
    return table
