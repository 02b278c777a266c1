"""The table of results in the README, made from the published tables of the real events.

``python -m accelerated_evaluation.publishing.readme`` writes it into ``README.md`` anew.
"""

from pathlib import Path

import pandas as pd

from accelerated_evaluation.files import write_text

ROOT = Path(__file__).resolve().parents[3]
CLAIMS = ROOT / "figures" / "spmd" / "tables" / "claims.csv"
README = ROOT / "README.md"
COMMAND = "python -m accelerated_evaluation.publishing.readme"
BEGIN = f"<!-- results: made from figures/spmd/tables by {COMMAND} -->\n"
END = "<!-- end of results -->\n"
SHOWN = (
    "crash probability of one lane change",
    "simulations to converge, piecewise, mean",
    "simulations to converge, single, mean",
    "single / piecewise",
    "simulations to converge, crude Monte Carlo",
    "crude / piecewise",
    "fitted parameters, piecewise",
)


def results_table(claims: pd.DataFrame) -> str:
    """Return the claims that the README shows as a Markdown table: paper, ours, spread, verdict."""
    lines = ["| | paper | ours | our spread | verdict |", "| --- | --- | --- | --- | --- |"]
    for claim, row in claims.set_index("claim").loc[list(SHOWN)].iterrows():
        spread = f"{_number(row.ours_low)} to {_number(row.ours_high)} ({row.spread})"
        cells = (claim, _number(row.paper), _number(row.ours), spread, row.verdict)
        lines.append(f"| {' | '.join(cells)} |")
    return "\n".join(lines) + "\n"


def with_results(readme: str, table: str) -> str:
    """Return the text of the README with the table between its marks."""
    before, rest = readme.split(BEGIN)
    return before + BEGIN + table + END + rest.split(END)[1]


def _number(value: float) -> str:
    return f"{value:,.0f}" if 10 <= value < 1e6 else f"{value:.3g}"


if __name__ == "__main__":
    write_text(README, with_results(README.read_text(encoding="utf-8"), results_table(pd.read_csv(CLAIMS))))
