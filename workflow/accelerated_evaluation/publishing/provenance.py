"""Provenance of a study: its commit, its configuration, and the checksums of its published files.

It is written to one file next to the results. The figures themselves contain no commit, so that a tracked
figure changes only if what it shows changes.
"""

import re
import subprocess
from collections.abc import Iterable
from functools import cache
from pathlib import Path
from typing import Any

from accelerated_evaluation.base.files import PROJECT, file_digest
from accelerated_evaluation.publishing.study import Study

# The results depend on these parts of the project only.
PARTS = ("workflow", "notebooks", "config", "data", "fewruns/src")
UNKNOWN = "unknown (not a git repository)"


def origin_of(study: Study) -> dict[str, str]:
    """Return the name of a study, its commit, and the SHA-256 of its file ``config.json``, by key."""
    return {
        "study": study.name,
        "commit": commit_of(PROJECT),
        "configuration": file_digest(study.path("config.json")),
    }


def provenance_of(study: Study, published: Iterable[Path]) -> dict[str, Any]:
    """Return the origin of a study (`origin_of`), and the SHA-256 of each of its published files by name."""
    files = {path.relative_to(study.figures).as_posix(): file_digest(path) for path in sorted(published)}
    return {**origin_of(study), "published": files}


@cache
def commit_of(project: Path) -> str:
    """Return the last commit of a project that changed anything on which its results depend.

    Commits that change only a text, a test or the published figures are ignored. The result is 40 hexadecimal
    digits, with " with changes" appended if files differ from the committed ones, or `UNKNOWN` without git or
    outside of a repository.
    """
    try:
        commit = _git(project, "log", "-1", "--format=%H", "--", *PARTS)
        changes = _git(project, "status", "--porcelain", "--", *PARTS)
    except (OSError, subprocess.CalledProcessError):
        return UNKNOWN
    if not commit:
        return UNKNOWN
    return f"{commit} with changes" if changes else commit


def page_of_code(project: Path, path: Path, line: int) -> str | None:
    """Return the address of a line of code at the commit of a project, as web pages of repositories have it.

    None is returned if the address is not known: without git, without a remote repository ``origin``, or if
    files differ from the committed ones.
    """
    commit = commit_of(project)
    try:
        origin = _git(project, "remote", "get-url", "origin")
    except (OSError, subprocess.CalledProcessError):
        return None
    parts = re.fullmatch(r"(?:https://|ssh://)?(?:[^@/]*@)?([^:/]+)[:/](.+?)(?:\.git)?/?", origin)
    if parts is None or not re.fullmatch("[0-9a-f]{40}", commit):
        return None
    file = path.resolve().relative_to(project.resolve()).as_posix()
    return f"https://{parts[1]}/{parts[2]}/blob/{commit}/{file}#L{line}"


def figure_metadata(name: str, study: str, title: str = "") -> dict[str, dict[str, str]]:
    """Return the metadata for the files of a figure, by file format; they name the figure and its study.

    The title is the finding of the figure, or its name if there is none.
    """
    title = title or name
    text = f"Figure {name} of the study {study}, made by accelerated-evaluation."
    return {
        "png": {"Title": title, "Description": text},
        "pdf": {"Title": title, "Subject": text},
        "svg": {"Title": title, "Description": text},
    }


def _git(project: Path, *arguments: str) -> str:
    """Return the output of a git command that is run in the folder of a project."""
    command = ["git", "-C", str(project), *arguments]
    return subprocess.run(command, check=True, capture_output=True, text=True).stdout.strip()
