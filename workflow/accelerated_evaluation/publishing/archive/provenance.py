"""Provenance of a figure: study, commit and configuration, stored in the metadata of its file."""

import hashlib
import subprocess
from collections.abc import Mapping
from functools import cache
from pathlib import Path
from typing import Any

from accelerated_evaluation.base.project import PROJECT
from accelerated_evaluation.publishing.study import Study

# The results depend on these parts of the project. Commits that change only other files, such as
# documentation, tests or the published figures themselves, are ignored, because they do not change the
# results.
PARTS = ("workflow", "notebooks", "config", "data")
UNKNOWN = "unknown (not a git repository)"


def origin_of(study: Study) -> dict[str, str]:
    """Return the name of a study, its commit, and the SHA-256 of its file ``config.json``, by key."""
    configuration = study.path("config.json").read_bytes()
    return {
        "study": study.name,
        "commit": commit_of(PROJECT),
        "configuration": hashlib.sha256(configuration).hexdigest(),
    }


@cache
def commit_of(project: Path) -> str:
    """Return the last commit of a project that changed anything on which its results depend.

    Published figures contain this commit, and are committed themselves afterwards. If they contained the
    latest commit of the repository instead, each new version of the figures would change the next one.

    Returns
    -------
    str
        The 40 hexadecimal digits of the commit, with " with changes" appended if files differ from the
        committed ones; `UNKNOWN` without git or outside of a repository.
    """
    try:
        commit = _git(project, "log", "-1", "--format=%H", "--", *PARTS)
        changes = _git(project, "status", "--porcelain", "--", *PARTS)
    except (OSError, subprocess.CalledProcessError):
        return UNKNOWN
    if not commit:
        return UNKNOWN
    return f"{commit} with changes" if changes else commit


def described(name: str, origin: Mapping[str, str]) -> dict[str, dict[str, Any]]:
    """Return the metadata for the files of a figure: for each file format a dictionary with its own keys.

    Parameters
    ----------
    name
        Name of the figure.
    origin
        Study, commit and configuration, as from `origin_of`; empty if they are not known.
    """
    if not origin:
        return {"png": {}, "pdf": {}, "svg": {}}
    text = (
        f"Figure {name} of the study {origin['study']}, made by accelerated-evaluation, "
        f"commit {origin['commit']}, from the configuration with SHA-256 {origin['configuration']} "
        f"(results/{origin['study']}/config.json)."
    )
    pairs = [f"{key}: {value}" for key, value in origin.items()]
    return {
        "png": {
            "Title": name,
            "Description": text,
            **{key.capitalize(): value for key, value in origin.items()},
        },
        "pdf": {"Title": name, "Subject": text, "Keywords": ", ".join(pairs)},
        "svg": {"Title": name, "Description": text, "Keywords": pairs},
    }


def _git(project: Path, *arguments: str) -> str:
    """Return the output of a git command that is run in the folder of a project."""
    command = ["git", "-C", str(project), *arguments]
    return subprocess.run(command, check=True, capture_output=True, text=True).stdout.strip()
