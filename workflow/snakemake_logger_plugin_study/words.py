"""The words of the console: durations, reasons, progress and errors."""

import argparse
import re
import shutil
from collections.abc import Sequence
from pathlib import Path

from accelerated_evaluation.base.errors import StudyError, forbidden

# Beginnings of Snakemake's messages about itself, which are kept in the log under .snakemake/log.
NOISE = (
    "Assuming unrestricted", "Building DAG", "Using shell", "Provided cores", "Rules claiming", "Select jobs",
    "Execute ", "Elapsed time", "host:", "Complete log", "Conda environments", "Config file", "Shutting down",
    "Exiting because", "Removing output", "Removing temporary", "Reasons:", "This was a dry-run",
    "Some jobs were triggered", "Rules with", "Shell command", "Singularity", "Job stats",
)  # fmt: skip
LAST_BYTES = 4096  # of a log, where its latest progress is
LAST_LINES = 30  # of an error that is shown


def is_noise(message: str) -> bool:
    """Tell whether a message is of no interest to who runs a study."""
    return not message.strip() or message.lstrip().startswith(NOISE)


def duration(seconds: float) -> str:
    """Write a time as in ``3.2 s`` or ``2 min 05 s``."""
    if seconds < 60:
        return f"{max(seconds, 0):.1f} s"
    minutes, rest = divmod(round(seconds), 60)
    return f"{minutes} min {rest:02d} s"


PARAMS = "Params have changed since last execution"


def short_reason(reason: str) -> str:
    """Shorten Snakemake's reason for a job: only files that somebody edited are named."""
    parts = []
    for part in reason.split("; "):
        kind, _, files = part.partition(": ")
        words = {"Updated input files": f"edited {files}", PARAMS: "changed settings or code of the library"}
        parts.append(words.get(kind, kind[:1].lower() + kind[1:]))
    return "; ".join(parts)


def progress_of(logs: Sequence[str]) -> str:
    """Return how far a job is, as in ``45 % ``, by the last progress bar in its log; empty without one."""
    if not logs or not Path(logs[0]).is_file():
        return ""
    with open(logs[0], "rb") as file:
        file.seek(max(Path(logs[0]).stat().st_size - LAST_BYTES, 0))
        bars = re.findall(rb"(\d+)%\|", file.read())
    return f"{int(bars[-1])} % " if bars else ""


def plain_error(message: str) -> str:
    """Return an error of Snakemake without the names of its classes and the lines of its code.

    An error about a file before anything runs is reported without a traceback, and any other error with one.
    """
    if path := re.search(r"\[Errno (?:13|30)\] (?:Permission denied|Read-only file system): '(.+)'", message):
        return f"error: {forbidden(path[1])}"
    if message.startswith("Traceback"):
        last = message.strip().splitlines()[-1]
        is_of_file = re.match(r"(OS|FileNotFound|IsADirectory|Permission|UnicodeDecode)Error: ", last)
        return f"error: {last.partition(': ')[2]}" if is_of_file else message
    if "Directory cannot be locked" in message:
        return f"error: another run makes files of this study in {Path.cwd()}; wait for it to end, or stop it"
    lines = [line for line in message.splitlines() if not re.match(r'  File ".*", line \d+', line)]
    if lines and re.match(r"\w+(Error|Exception)( in file .*)?:$", lines[0]):
        lines = lines[1:]
    return "error: " + "\n".join(lines).strip()


def fault_of_configuration(arguments: Sequence[str]) -> str:
    """Return which configuration file cannot be read, and why; Snakemake reports neither file nor line.

    Parameters
    ----------
    arguments
        Those that Snakemake was called with.

    Returns
    -------
    str
        Empty if all files can be read.
    """
    from accelerated_evaluation.study.configuration import read_yaml  # takes time, which errors alone ask for

    parser = argparse.ArgumentParser(add_help=False, allow_abbrev=False)
    parser.add_argument("--configfile", "--configfiles", nargs="+", default=[])
    for path in parser.parse_known_args(arguments)[0].configfile:
        try:
            read_yaml(Path(path))
        except StudyError as error:
            return f"error: {error}"
    return ""


def failure(what: str, rule: str, logs: Sequence[str], errors: Sequence[str]) -> str:
    """Tell how a job failed, its own message last.

    Parameters
    ----------
    what, rule
        What the job does, and its rule.
    logs
        Log files of the job.
    errors
        What Snakemake said; the last of it counts where the job said nothing.
    """
    text = Path(logs[0]).read_text(errors="replace") if logs and Path(logs[0]).is_file() else ""
    starts = [match.start() for match in re.finditer(r"^(error: |Traceback \(most)", text, re.MULTILINE)]
    message = "\n".join(text[starts[0] if starts else 0 :].splitlines()[-LAST_LINES:]).strip()
    if not starts and shutil.disk_usage(Path.cwd()).free < LAST_BYTES:
        message = "error: no space left on the disk; free some and run the study again"
    elif not starts:
        how = errors[-1].splitlines()[-1] if errors else "error: it was ended from outside"
        message = f"{message}\n{how}; the job left no message.".strip()
    return f"failed: {what} (rule {rule}{f', log {logs[0]}' if logs else ''})\n{message}"
