"""A summary of the simulated motorways in words and tables, which `make world` shows at its end."""

import argparse
import re
from pathlib import Path

import pandas as pd
from accelerated_evaluation.base.files import write_text
from accelerated_evaluation.publishing.named_numbers import Tables
from accelerated_evaluation.publishing.texts import FILLED, fill
from chain import BLOCK, FEWEST_BLOCKS, FEWEST_RECORDS
from traffic import run_command

README = Path(__file__).with_name("README.md")


def tables(folder: Path) -> dict[str, str]:
    """Return the tables of README in Markdown, made from the files in a folder, by the names of the files."""
    names = {"results": Tables(folder)}
    templates = (found[1] for found in FILLED.finditer(README.read_text(encoding="utf-8")))
    whole = [each for each in templates if each.startswith("\n")]  # the others are numbers in sentences
    return {re.search(r"results\.(\w+)", each)[1]: fill(each, names) for each in whole}


def summary(folder: Path) -> str:
    """Return the summary of the tables in a folder."""
    counts, chain = (pd.read_csv(folder / f"motorway{name}.csv") for name in ("", "_chain"))
    crashes, made = counts["counted"].sum(), tables(folder)
    crashed = (
        f"The hosts crashed {crashes:,.0f} times." if crashes else "No host crashed: simulate more hours."
    )
    text = "# Crashes counted on simulated motorways\n\n"
    text += f"{counts.groupby('host')['cut_ins'].sum().iloc[0]:,.0f} cut-ins. {crashed}\n"
    if counts["recorded"].isna().any():
        text += "There were too few recorded cut-ins for a prediction with recorded lead motion.\n"
    text += f"\n## Counted and predicted crashes\n\n{made['motorway']}"
    text += f"\n## Cut-ins that extract found in the recordings\n\n{made['motorway_extraction']}"
    text += "\n## In how many worlds the whole chain covers the count\n\n"
    missing = chain.loc[chain["median"].isna(), "world"].nunique()
    if missing:
        minutes = f"{FEWEST_BLOCKS * BLOCK / 60:.0f} minutes"
        text += (
            f"The recordings of {missing} of {chain['world'].nunique()} worlds are too short: a prediction "
        )
        text += f"needs {FEWEST_RECORDS} closing cut-ins and {minutes}. Record more hours.\n"
    if chain["median"].notna().any():
        text += made["motorway_chain"]
    return text + f"\nThe tables are in {folder}.\n"


def main() -> None:
    """Write the summary."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path, help="of the tables")
    parser.add_argument("--output", required=True, help="Markdown file")
    arguments = parser.parse_args()
    write_text(arguments.output, summary(arguments.folder))


if __name__ == "__main__":
    run_command(main)
