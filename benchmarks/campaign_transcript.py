"""Drive the campaign of docs/campaign.md under a finished study, and show where it ended.

Run as ``python benchmarks/campaign_transcript.py [--write]`` after ``make study``. The commands are those of
the guide, in their order; the last ask, simulate and tell are repeated until the campaign may stop. With
``--write`` the transcript takes the place of the one in the guide, and ``benchmarks/results/campaign.csv``
receives the exact crash probability, and the shares of cut-ins beyond limits. The guide has placeholders for
these numbers.
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
from accelerated_evaluation.base.files import write_csv, write_text
from accelerated_evaluation.laws import Law
from accelerated_evaluation.laws.files import read_law
from accelerated_evaluation.records.segments import read_encounters
from accelerated_evaluation.track.campaign_file import read_campaign
from accelerated_evaluation.track.limits import USUAL, Limits

ROOT = Path(__file__).resolve().parents[1]
GUIDE = ROOT / "docs" / "campaign.md.in"
MOST_ROUNDS = 200
LAST_ROUND = 3  # commands: ask, simulate, tell
TRANSCRIPT = r"(?m)^    event .*\n(?:    .+\n)+"
NUMBERS = ROOT / "benchmarks" / "results" / "campaign.csv"
LIMITS = {
    "host_speed_50": Limits(host_speed_max=50.0),
    "range_0.5": Limits(range_min=0.5),
    "usual": USUAL,
    "closing_speed_25": Limits(closing_speed_max=25.0),
    "range_1": Limits(range_min=1.0),
    "range_2": Limits(range_min=2.0),
}


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


def with_transcript(text: str, transcript: str) -> str:
    """Return the guide with another transcript."""
    indented = "".join(f"    {line}\n" for line in transcript.splitlines())
    text, transcripts = re.subn(TRANSCRIPT, lambda _: indented, text)
    if transcripts != 1:
        raise SystemExit(f"{GUIDE} must have one transcript")
    return text


def numbers_of(law: Law, exact: float) -> pd.DataFrame:
    """Return the exact crash probability under a law, and the probability of cut-ins beyond each limit."""
    found = {"crash": exact} | {name: limits.beyond(law) for name, limits in LIMITS.items()}
    return pd.DataFrame(found.items(), columns=["what", "probability"])


def main() -> None:
    """Print the transcript, and write it into the guide if that is asked for."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--results", type=Path, default=ROOT / "results", help="folder results/ of the study")
    parser.add_argument("--write", action="store_true", help="write the transcript into the guide's template")
    arguments = parser.parse_args()
    results, text = arguments.results.resolve(), GUIDE.read_text(encoding="utf-8")
    with tempfile.TemporaryDirectory() as folder, contextlib.chdir(folder):
        os.symlink(results, "results")
        transcript, law = drive(text), read_campaign("campaign.json").description
    laws = pd.read_csv(results / "spmd" / "laws" / "laws.csv", index_col="law")
    exact = laws.loc[law, "probability"]
    print(f"{transcript}exact       {exact:.3g} under the law {law!r}, without limits")
    if arguments.write:
        write_text(GUIDE, with_transcript(text, transcript))
        study = results / "spmd"
        heaviest = read_law(study / "laws/answer.json", read_encounters(study / "encounters.parquet"))
        write_csv(NUMBERS, numbers_of(heaviest, exact))


if __name__ == "__main__":
    main()
