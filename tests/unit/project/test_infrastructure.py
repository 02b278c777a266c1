"""Files whole or not at all, generators by name, and the log of a rule's script."""

import errno
import itertools
import json
import math
import os
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pandas as pd
import pytest
from accelerated_evaluation import StudyError, child_generator
from accelerated_evaluation.base.files import atomic_path, read_json, write_csv, write_json, write_text
from accelerated_evaluation.study.jobs import LOGGER_VARIABLE, release_dead_locks


class Interruption(BaseException):
    """Stands for a keyboard interrupt."""


def test_links_devices_and_folders_stay_what_they_are(tmp_path):
    (tmp_path / "real.txt").write_text("before")
    link, pipe = tmp_path / "link.txt", tmp_path / "pipe"
    link.symlink_to("real.txt")
    write_text(link, "after")
    assert link.is_symlink()
    assert (tmp_path / "real.txt").read_text() == "after"
    os.mkfifo(pipe)
    with ThreadPoolExecutor(1) as reader:
        read = reader.submit(pipe.read_text)
        write_text(pipe, "through the pipe")
        assert read.result() == "through the pipe"
    assert pipe.is_fifo()
    with pytest.raises(StudyError, match="is a folder; name a file"):
        write_text(tmp_path, "")
    with pytest.raises(StudyError, match="cannot be written"):
        write_text(link / "below.txt", "")


@pytest.mark.parametrize("error", [ValueError, Interruption])
@pytest.mark.parametrize("before", [None, "old"])
def test_a_failed_write_leaves_nothing_behind(tmp_path, error, before):
    path = tmp_path / "table.csv"
    if before is not None:
        path.write_text(before)

    def fail():
        with atomic_path(path) as temporary:
            temporary.write_text("half")
            assert temporary.suffix == ".csv"
            raise error

    with pytest.raises(error):
        fail()
    assert [file.read_text() for file in tmp_path.iterdir()] == ([] if before is None else [before])


def test_a_write_appears_whole_where_folders_were_missing(tmp_path):
    path = tmp_path / "new" / "folder" / "text.txt"
    with atomic_path(path) as temporary:
        temporary.write_text("whole")
        assert not path.exists()
    assert [file.name for file in path.parent.iterdir()] == ["text.txt"]
    assert path.read_text() == "whole"
    write_text(path, "Größe")
    assert path.read_bytes() == "Größe".encode()


@pytest.mark.parametrize("value", [math.nan, math.inf, [1.0, {"a": -math.inf}], {1, 2}])
def test_json_refuses_what_it_cannot_hold(tmp_path, value):
    with pytest.raises((ValueError, TypeError)):
        write_json(tmp_path / "value.json", value)
    assert not any(tmp_path.iterdir())


def test_numbers_come_back_equal(tmp_path):
    numbers = [0.1, 1 / 3, 5e-324, 1.7976931348623157e308, -0.0, 1e22]
    write_json(tmp_path / "numbers.json", numbers)
    assert json.dumps(read_json(tmp_path / "numbers.json")) == json.dumps(numbers)
    write_csv(tmp_path / "numbers.csv", pd.DataFrame({"number": numbers}))
    header, *rows = (tmp_path / "numbers.csv").read_text().splitlines()
    assert header == "number"
    assert np.array(rows, dtype=float).tobytes() == np.array(numbers).tobytes()


PATHS = [
    (),
    ("sample",),
    ("cross_entropy", "single", "5-15", 0),
    ("cross_entropy", "single", "5-15", 1),
    ("cross_entropy", "single", "15-25", 0),
    ("cross_entropy", "piecewise", "5-15", 0),
    ("single", "cross_entropy", "5-15", 0),
    ("cross_entropy", "single", "5-15"),
    ("cross_entropy", "single", "5-15", 0, 0),
]


def test_a_generator_is_known_by_its_path_alone():
    first = {path: child_generator(2016, *path).random(4).tolist() for path in PATHS}
    again = {path: child_generator(2016, *path).random(4).tolist() for path in reversed(PATHS)}
    assert first == again
    for one, two in itertools.combinations(first.values(), 2):
        assert not set(one) & set(two)
    assert child_generator(2017, *PATHS[2]).random(4).tolist() not in first.values()
    # Fixed, so that a study can be repeated in years to come.
    assert child_generator(2016, "sample").integers(10**9) == 128627084


SCRIPT = """
import os, subprocess, sys, warnings
from accelerated_evaluation.base.errors import InputError
from accelerated_evaluation.study.jobs import job
with job(sys.argv[1]):
    print("progress", file=sys.stderr)
    warnings.warn("beware")
    subprocess.run([sys.executable, "-c", "import os; os.write(2, b'from a child')"])
    {}
print("done")
"""


@pytest.mark.parametrize(
    ("ending", "status", "message"),
    [
        ("pass", 0, ""),
        (
            "raise InputError('a.csv', seen='x', expected='y', change='Mend it.')",
            1,
            "error: a.csv: seen x; expected y. Mend it.",
        ),
        ("1 / 0", 1, "ZeroDivisionError: division by zero"),
        ("sys.exit(0)", 1, "error: the job was ended by sys.exit(0)"),
        ("open('/dev/full', 'wb', buffering=0).write(b'x')", 1, "error: no space left on the disk"),
        ("raise PermissionError(13, 'denied', 'a.csv')", 1, "error: a.csv: seen no permission to use it;"),
    ],
)
@pytest.mark.parametrize("logger", [None, "study"])
def test_a_job_keeps_its_log_and_ends_as_it_should(tmp_path, monkeypatch, ending, status, message, logger):
    monkeypatch.delenv(LOGGER_VARIABLE, raising=False)
    if logger:
        monkeypatch.setenv(LOGGER_VARIABLE, logger)
    log = tmp_path / "job.log"
    command = [sys.executable, "-c", SCRIPT.format(ending), str(log)]
    ended = subprocess.run(command, capture_output=True, text=True, timeout=60, check=False)
    assert ended.returncode == status
    assert ended.stdout == ("done\n" if status == 0 else "")
    for part in ("progress", "UserWarning: beware", "from a child", message):
        assert part in log.read_text()
    assert ("Traceback" in log.read_text()) == ("division" in message)
    # The logger of the workflow shows the message at the end; without one the job tells it.
    assert ended.stderr in log.read_text()
    assert bool(ended.stderr) == (status != 0 and logger is None)


def test_a_job_whose_log_cannot_be_written_tells_the_terminal(monkeypatch):
    monkeypatch.setenv(LOGGER_VARIABLE, "study")
    command = [sys.executable, "-c", SCRIPT.format("1 / 0"), "/dev/full"]
    ended = subprocess.run(command, capture_output=True, text=True, timeout=60, check=False)
    assert ended.returncode == 1
    assert "no space left" in ended.stderr


def test_a_full_disk_is_told_with_the_file_and_leaves_nothing(tmp_path):
    reported = r"no space left on the disk to write .*table\.csv"
    with pytest.raises(StudyError, match=reported), atomic_path(tmp_path / "table.csv"):
        raise OSError(errno.ENOSPC, "No space left on device")
    assert not list(tmp_path.iterdir())


def test_what_a_killed_process_left_is_removed_by_the_next(tmp_path):
    path = tmp_path / "notebook.ipynb"
    killed = "import os, sys; from accelerated_evaluation.base.files import atomic_path\n"
    killed += "with atomic_path(sys.argv[1]): os.kill(os.getpid(), 9)"
    subprocess.run([sys.executable, "-c", killed, str(path)], check=False)
    other = tmp_path / f".notebook.ipynb.{os.getpid()}.abc.ipynb"  # of a process that is alive
    other.touch()
    assert len(list(tmp_path.iterdir())) == 2
    write_text(path, "whole")
    assert set(tmp_path.iterdir()) == {path, other}


HOLD = """
import sys
from accelerated_evaluation.study.jobs import release_dead_locks
held = release_dead_locks(sys.argv[1])
print("alive", flush=True)
sys.stdin.read()
"""


def test_locks_of_a_living_run_stay_and_those_of_a_killed_one_go(tmp_path):
    lock = tmp_path / "locks" / "0.output.lock"
    command = [sys.executable, "-c", HOLD, str(tmp_path)]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE) as run:
        assert run.stdout.readline() == b"alive\n"
        lock.parent.mkdir()
        lock.touch()
        release_dead_locks(tmp_path).close()
        assert lock.exists()
        run.kill()
    release_dead_locks(tmp_path).close()
    assert not lock.exists()


def test_no_text_of_a_table_is_a_formula(tmp_path):
    texts = ["=cmd()", "@sum", "a=b", None, "+1+2", "-2+3", "\t=1", "-1.5"]
    table = pd.DataFrame({"=file()": texts, "value": -1.5})
    write_csv(tmp_path / "t.csv", table)
    found = pd.read_csv(tmp_path / "t.csv", dtype=str)
    assert list(found) == ["'=file()", "value"]
    quoted = ["'=cmd()", "'@sum", "a=b", None, "'+1+2", "'-2+3", "'\t=1", "-1.5"]
    assert found["'=file()"].replace({np.nan: None}).tolist() == quoted
    assert (found["value"] == "-1.5").all()


@pytest.mark.studies
def test_nothing_needs_a_writable_home(tmp_path):
    """A home folder on a read-only disk, and a package in a folder that is not writable either."""
    program = """
import pkgutil, importlib, sys
import numba.core.caching as caching
def refuse(self):
    raise OSError("read-only")
caching.InTreeCacheLocator.ensure_cache_path = refuse
import accelerated_evaluation
for module in pkgutil.walk_packages(accelerated_evaluation.__path__, "accelerated_evaluation."):
    importlib.import_module(module.name)
from accelerated_evaluation import cli
sys.exit(cli.main(["simulate", "in.csv", "out.csv"]))
"""
    (tmp_path / "in.csv").write_text("lead_speed,range,closing_speed\n20,10,8\n")
    environment = {"PATH": os.environ["PATH"], "HOME": "/dev/null", "PYTHONDONTWRITEBYTECODE": "1"}
    environment["MPLCONFIGDIR"] = str(tmp_path)  # Matplotlib itself warns, and then uses a temporary folder
    done = subprocess.run(
        [sys.executable, "-c", program],
        cwd=tmp_path,
        env=environment,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "out.csv").read_text().count("\n") == 2
