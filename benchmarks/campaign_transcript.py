"""Drive the campaign of docs/campaign.md under a finished study, and show where it ended.

Run as ``python benchmarks/campaign_transcript.py [--write]`` after ``make study``. The commands are those of
the guide, in their order; the last ask, simulate and tell are repeated until the campaign may stop. With
``--write`` the transcript takes the place of the one in the guide.
"""

import argparse
import contextlib
import io
import os
import re
import shlex
import tempfile
from pathlib import Path

import pandas as pd
from accelerated_evaluation import cli
from accelerated_evaluation.base.files import write_text
from accelerated_evaluation.publishing.texts import unbroken
from accelerated_evaluation.track.campaign_file import read_campaign

ROOT = Path(__file__).resolve().parents[1]
GUIDE = ROOT / "docs" / "campaign.md"
MOST_ROUNDS = 200
LAST_ROUND = 3  # commands: ask, simulate, tell
TRANSCRIPT = r"(?m)^    event .*\n(?:    .+\n)+"
EXACT = r"(?<=The exact value under this law is )\d[^,]+(?=, without)"


def commands(text: str) -> list[list[str]]:
    """Return the arguments of each command of the guide."""
    blocks = re.findall(r"```sh\n(.*?)```", text, flags=re.DOTALL)
    lines = [line for block in blocks for line in block.replace("\\\n", " ").splitlines() if line]
    return [shlex.split(line)[1:] for line in lines if line.startswith("accelerated-evaluation")]


def drive(text: str) -> str:
    """Run the commands of the guide in the current folder, and return the status where it may stop."""
    steps = commands(text)
    end = 1 + max(place for place, step in enumerate(steps) if step[:2] == ["campaign", "tell"])
    for step in steps[:end]:
        _run(step)
    for _ in range(MOST_ROUNDS):
        if read_campaign("campaign.json").estimate().converged:
            break
        for step in steps[end - LAST_ROUND : end]:
            _run(step)
    for step in steps[end:]:
        _run(step)
    return _run(["campaign", "status", "campaign.json"])


def _run(arguments: list[str]) -> str:
    said = io.StringIO()
    with contextlib.redirect_stdout(said):
        status = cli.main(arguments)
    if status:
        raise SystemExit(status)
    return said.getvalue()


def with_transcript(text: str, transcript: str, exact: float) -> str:
    """Return the guide with another transcript and another exact value."""
    indented = "".join(f"    {line}\n" for line in transcript.splitlines())
    text, transcripts = re.subn(TRANSCRIPT, lambda _: indented, text)
    text, values = re.subn(EXACT, unbroken(exact), text)
    if (transcripts, values) != (1, 1):
        raise SystemExit(f"{GUIDE} must have one transcript and one exact value")
    return text


def main() -> None:
    """Print the transcript, and write it into the guide if that is asked for."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--results", type=Path, default=ROOT / "results", help="folder results/ of the study")
    parser.add_argument("--write", action="store_true", help="write the transcript into docs/campaign.md")
    arguments = parser.parse_args()
    results, text = arguments.results.resolve(), GUIDE.read_text(encoding="utf-8")
    with tempfile.TemporaryDirectory() as folder, contextlib.chdir(folder):
        os.symlink(results, "results")
        transcript, law = drive(text), read_campaign("campaign.json").description
    laws = pd.read_csv(results / "spmd" / "laws" / "laws.csv", index_col="law")
    exact = laws.loc[law, "probability"]
    print(f"{transcript}exact       {exact:.3g} under the law {law!r}, without limits")
    if arguments.write:
        write_text(GUIDE, with_transcript(text, transcript, exact))


if __name__ == "__main__":
    main()
