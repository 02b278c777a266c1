"""Tell what living runs of the workflow hold from what dead ones left behind."""

import fcntl
import os
import shutil
from pathlib import Path
from typing import BinaryIO


def release_dead_locks(folder: str | os.PathLike = ".snakemake") -> BinaryIO:
    """Remove the locks that killed runs left in Snakemake's folder, and mark this run as alive.

    A run that is killed cannot remove its locks, and Snakemake cannot tell them from those of a run that is
    still at work. So every run keeps a file locked, shared with the others, until its process ends, however
    it ends. A run that gets this file for itself is alone, and all of Snakemake's locks are dead ones.

    Parameters
    ----------
    folder
        Snakemake's folder of what it knows about the files of the study.

    Returns
    -------
    BinaryIO
        The locked file; keep it open as long as the run lasts.
    """
    folder = Path(folder)
    folder.mkdir(exist_ok=True)
    mark = open(folder / "alive", "ab")  # noqa: SIM115, open as long as the run lasts
    try:
        fcntl.flock(mark, fcntl.LOCK_EX | fcntl.LOCK_NB)
        shutil.rmtree(folder / "locks", ignore_errors=True)
    except BlockingIOError:
        pass  # another run is alive, and the locks may be its own
    fcntl.flock(mark, fcntl.LOCK_SH)
    return mark
