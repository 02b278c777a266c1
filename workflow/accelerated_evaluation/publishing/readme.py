"""The tables of results in the README, made from the published tables.

``python -m accelerated_evaluation.publishing.readme`` writes them into ``README.md`` anew.
"""

from pathlib import Path

import pandas as pd

from accelerated_evaluation.files import write_text
from accelerated_evaluation.methods import METHODS

ROOT = Path(__file__).resolve().parents[3]
CLAIMS = ROOT / "figures" / "spmd" / "tables" / "claims.csv"
SAMPLERS = ROOT / "benchmarks" / "results" / "samplers.csv"
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
OURS = "surrogate"
RELIABLE = 0.05  # share of failed seeds up to which another sampler is called the best


def results_table(claims: pd.DataFrame) -> str:
    """Return the claims that the README shows as a Markdown table: paper, ours, spread, verdict."""
    lines = ["| | paper | ours | our spread | verdict |", "| --- | --- | --- | --- | --- |"]
    for claim, row in claims.set_index("claim").loc[list(SHOWN)].iterrows():
        spread = f"{_number(row.ours_low)} to {_number(row.ours_high)} ({row.spread})"
        cells = (claim, _number(row.paper), _number(row.ours), spread, row.verdict)
        lines.append(f"| {' | '.join(cells)} |")
    return "\n".join(lines) + "\n"


def samplers_table(samplers: pd.DataFrame) -> str:
    """Return, for each problem of the benchmark, what this project's sampler, the paper and others need.

    Of the others the one of fewest effective simulations is shown, among those that rarely fail.
    """
    lines = [
        "| problem | probability | this sampler | its true error | its 80 % intervals hold | failed "
        "| best of the paper's methods | best public tool |",
        "| --- | --- | --- | --- | --- | --- | --- | --- |",
    ]
    for name, rows in samplers.groupby("problem", sort=False):
        ours = rows[rows["method"] == OURS].iloc[0]
        others = rows[(rows["method"] != "crude") & (rows["failed"] <= RELIABLE) & (rows["method"] != OURS)]
        is_paper = others["method"].isin([name for name in METHODS if METHODS[name].learns_apart])
        cells = (
            name.replace("_", " "),
            f"{ours.reference:.2g}",
            f"{ours.calls_mean:,.0f}",
            f"{ours['error']:.2f}",
            f"{ours.coverage80:.0%}",
            f"{ours.failed * ours.seeds:.0f} of {ours.seeds:,.0f}",
            _best(others[is_paper]),
            _best(others[~is_paper]),
        )
        lines.append(f"| {' | '.join(cells)} |")
    return "\n".join(lines) + "\n"


def _best(rows: pd.DataFrame) -> str:
    if rows.empty:
        return "–"
    best = rows.loc[rows["effective_calls"].idxmin()]
    return f"{best.effective_calls:,.0f} ({best.method})"


TABLES = {
    "results": (f"made from figures/spmd/tables by {COMMAND}", CLAIMS, results_table),
    "samplers": (f"made from benchmarks/results by {COMMAND}", SAMPLERS, samplers_table),
}


def with_table(readme: str, name: str, table: str) -> str:
    """Return the text of the README with the table of a name between its marks."""
    begin, end = f"<!-- {name}: {TABLES[name][0]} -->\n", f"<!-- end of {name} -->\n"
    before, rest = readme.split(begin)
    return before + begin + table + end + rest.split(end)[1]


def with_tables(readme: str) -> str:
    """Return the text of the README with all its tables as they are published now."""
    for name, (_, path, make) in TABLES.items():
        readme = with_table(readme, name, make(pd.read_csv(path)))
    return readme


def _number(value: float) -> str:
    return f"{value:,.0f}" if 10 <= value < 1e6 else f"{value:.3g}"


if __name__ == "__main__":
    write_text(README, with_tables(README.read_text(encoding="utf-8")))
