"""DuckDB queries on CSV files of any size, with limited memory and a clear error for an unreadable file."""

import csv
import glob
import os
import re
import tempfile
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

from accelerated_evaluation.base.errors import InputError, StudyError, readable
from accelerated_evaluation.base.files import begins_in, is_disk_full
from accelerated_evaluation.base.tables import names_in_words

if TYPE_CHECKING:  # DuckDB is imported only when recordings are read, because the import takes a moment
    from duckdb import DuckDBPyConnection, DuckDBPyRelation

MEMORY = "1GB"  # limit of the database; the process needs a few hundred megabytes more
LARGEST_WHOLE = 2**53  # numbers are read as DOUBLE, which represents all whole numbers up to this one
NOT_WHOLE = "no whole number in the column"
THREADS = 2  # each thread needs memory


@contextmanager
def database() -> Iterator[tuple["DuckDBPyConnection", Path]]:
    """Yield an empty database with limited memory, and a folder for temporary files.

    The folder is made in the folder that ``TMPDIR`` names, and removed at the end of the block. StudyError is
    raised if there is no space left on the disk, and InputError if DuckDB is not installed.
    """
    try:
        import duckdb
    except ImportError as error:
        raise InputError(
            "recordings",
            seen="DuckDB, which reads them, is not installed",
            expected="the optional extra `recordings` of this package",
            change="Install it: pip install 'accelerated-evaluation[recordings]'.",
        ) from error

    with tempfile.TemporaryDirectory(prefix="accelerated-evaluation-") as folder:
        settings = {"memory_limit": MEMORY, "threads": THREADS, "temp_directory": f"{folder}/spill"}
        with duckdb.connect(config=settings | {"preserve_insertion_order": False}) as connection:
            try:
                yield connection, Path(folder)
            except (duckdb.IOException, duckdb.OutOfMemoryException, OSError) as error:
                if is_disk_full(error) or "space" in str(error) or "max_temp_directory_size" in str(error):
                    raise StudyError(
                        f"no space left for temporary files in {tempfile.gettempdir()}; free some space, or "
                        "set the environment variable TMPDIR to a folder on another disk, and run again"
                    ) from error
                raise


def recording_files(folder: str, pattern: str, key: str) -> list[Path]:
    """Return the files of a folder whose names match a shell pattern, in alphabetical order.

    InputError, which names the ``key`` of the configuration, is raised if there is no folder or no such file.
    """
    is_there = os.path.isdir(folder)
    files = sorted(path for path in Path(folder).glob(pattern) if path.is_file()) if is_there else []
    if not files:
        raise InputError(
            str(folder),
            seen=f"no file called {pattern}" if is_there else "no such folder",
            expected="a folder of recordings",
            change=f"Correct {key}{', or the names of the files.' if is_there else '.' + begins_in(folder)}",
        )
    return files


def header_of(path: Path, needed: Iterable[str]) -> list[str]:
    """Return the names of the columns of a CSV file.

    InputError is raised if the file is empty or is not text, or if a needed column is missing or occurs
    twice.
    """
    with readable(f"{path}, row 1", "CSV text in UTF-8", "Export it again.", (UnicodeDecodeError, csv.Error)):
        with path.open("rb") as file:
            line = file.readline().decode("utf-8-sig")
        header = [name.strip() for name in next(csv.reader([line]), [])]
    wrong = [name for name in needed if header.count(name) != 1]
    if wrong:
        missing = [name for name in wrong if name not in header]
        raise InputError(
            f"{path}, row 1",
            seen=f"{'no' if missing else 'more than one'} column {', '.join(missing or wrong)} among: "
            f"{names_in_words(header, wrong[0]) if header else 'none, the file is empty'}",
            expected=f"a comma-separated header with {', '.join(needed)}",
            change="Correct the header, or state the source that fits the files in data.source.",
        )
    return header


def csv_relation(
    connection: "DuckDBPyConnection", path: Path, numbers: Iterable[str], texts: Iterable[str] = ()
) -> "DuckDBPyRelation":
    """Return a CSV file as a DuckDB relation; the file is read again each time the relation is used.

    All columns except ``numbers`` are read as text. InputError is raised as by `header_of`.
    """
    numbers = list(numbers)
    header = header_of(path, [*numbers, *texts])
    types = {name: "DOUBLE" if name in numbers else "VARCHAR" for name in header}
    return connection.read_csv(
        glob.escape(str(path)), columns=types, header=True, delimiter=",", quotechar='"', auto_detect=False
    )


def literal(values: Iterable[object]) -> str:
    """Return values as an SQL list of strings, such as ``['a', 'b']``, with quotation marks escaped."""
    return "[" + ", ".join("'" + str(value).replace("'", "''") + "'" for value in values) + "]"


def whole(expression: str, column: str) -> str:
    """Return an SQL expression that converts a whole number of type DOUBLE to a BIGINT.

    If the number is not whole or is too large, the query ends with an error, which `csv_errors` converts to
    an `InputError`. A plain cast would round the number or return NULL, and thereby merge vehicles or lose
    rows.
    NULL, NaN and infinity become NULL, like a cell without a number.
    """
    return (
        f"CASE WHEN isfinite({expression}) IS NOT TRUE THEN NULL "
        f"WHEN {expression} = trunc({expression}) AND abs({expression}) < {LARGEST_WHOLE} "
        f"THEN CAST({expression} AS BIGINT) "
        f"ELSE error('{NOT_WHOLE} {column}: ' || CAST({expression} AS VARCHAR)) END"
    )


@contextmanager
def csv_errors(path: Path) -> Iterator[None]:
    """Convert a database error of the ``with`` block, if a CSV file is the cause, to an `InputError`."""
    import duckdb

    try:
        yield
    except (duckdb.DataError, duckdb.ProgrammingError) as error:
        if found := re.search(f"{NOT_WHOLE} (.*?): (.*)", str(error)):
            raise InputError(
                f"{path}, column {found[1]}",
                seen=found[2],
                expected=f"whole numbers below 2^53 ({LARGEST_WHOLE:,}), which are represented exactly",
                change="Correct the cell, or number vehicles, trips and devices by smaller whole numbers.",
            ) from error
        line = re.search(r"CSV Error on Line: (\d+)", str(error))
        if line is None and not isinstance(error, duckdb.ConversionException | duckdb.OutOfRangeException):
            raise
        cause = re.search(
            r"(Error when converting .*|Could not convert .*|Expected Number of .*|Value with .*"
            r"|Type .* can't be cast .*|.*[Oo]verflow.*|.*unicode.*)",
            str(error),
        )
        seen = cause[0] if cause else str(error).splitlines()[-1]
        raise InputError(
            f"{path}, row {line[1]}" if line else str(path),
            seen=" ".join(seen.split()),
            expected="as many cells as in the header, numbers in the columns of numbers, and UTF-8",
            change="Correct or remove this row, or export the file again.",
        ) from error
