"""Remove the Snakemake locks of runs that were killed, without touching those of active runs."""

import fcntl
import os
import shutil
from pathlib import Path
from typing import BinaryIO


def release_dead_locks(folder: str | os.PathLike = ".snakemake") -> BinaryIO:
    """Remove the locks that killed runs left in Snakemake's folder, and mark this run as active.

    A run that is killed cannot remove its locks, and Snakemake cannot distinguish them from the locks of an
    active run. Every run therefore holds a shared lock on a file until its process ends. If a run can lock
    this file exclusively, no other run is active, and all of Snakemake's locks are left over from killed
    runs. The result is the locked file; keep it open until the run ends.
    """
    folder = Path(folder)
    folder.mkdir(exist_ok=True)
    mark = open(folder / "alive", "ab")  # noqa: SIM115, open as long as the run lasts
    try:
        fcntl.flock(mark, fcntl.LOCK_EX | fcntl.LOCK_NB)
        shutil.rmtree(folder / "locks", ignore_errors=True)
    except BlockingIOError:
        pass  # another run is active, to which the locks may belong
    fcntl.flock(mark, fcntl.LOCK_SH)
    return mark
