"""Files: written completely or not at all, their digests, and those of the project outside this package."""

import errno
import hashlib
import json
import os
import re
import tempfile
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

from accelerated_evaluation.base.errors import InputError, StudyError

if TYPE_CHECKING:  # importing pandas takes half a second, and many programs write no table
    import pandas as pd

_LIBRARY = Path(__file__).resolve().parents[1]
# The default configuration, its schema, and the records of the project are in the folders config, data and
# ``workflow`` of a copy of the repository. A wheel contains them as ``accelerated_evaluation/project``.
_PACKAGED = _LIBRARY / "project"
FORMULA = ("=", "@", "+", "-", "\t", "\r")  # beginnings of the texts that a spreadsheet runs
PROJECT = _PACKAGED if _PACKAGED.is_dir() else _LIBRARY.parents[1]


@contextmanager
def atomic_path(path: str | os.PathLike) -> Iterator[Path]:
    """Yield a temporary path next to ``path``; it is renamed to ``path`` if the block ends without an error.

    If the process is killed inside the block, the temporary file remains. The next process that writes the
    same path removes it. A link remains a link. A device or a pipe is not replaced; the content is written to
    it. StudyError is raised if ``path`` is a folder, its folder cannot be written to, or there is no space
    left on the disk.
    """
    path = Path(path)
    try:
        if path.is_dir():
            raise StudyError(f"{path} is a folder; name a file to write")
        is_special = path.exists() and not path.is_file()
        folder = Path(tempfile.gettempdir()) if is_special else path.resolve().parent
        folder.mkdir(parents=True, exist_ok=True)
        _remove_abandoned(path, folder)
        handle, name = tempfile.mkstemp(prefix=f".{path.name}.{os.getpid()}.", suffix=path.suffix, dir=folder)
    except (OSError, ValueError, RuntimeError) as error:  # the others if the name is none, or a link a loop
        raise _unwritable(path, error) from error
    os.close(handle)
    temporary = Path(name)
    try:
        yield temporary
        if is_special:
            path.write_bytes(temporary.read_bytes())
        else:
            temporary.chmod(0o644)
            temporary.replace(path.resolve())
    except OSError as error:
        if is_disk_full(error):
            raise _unwritable(path, error) from error
        raise
    finally:
        temporary.unlink(missing_ok=True)


def _unwritable(path: Path, error: Exception) -> StudyError:
    """Return the error that says why a file cannot be written."""
    if is_disk_full(error):
        return StudyError(f"no space left on the disk to write {path}; free some space and run again")
    is_file = os.path.exists(path.parent) and not path.parent.is_dir()
    reason = "a file stands where its folder should be" if is_file else getattr(error, "strerror", error)
    return StudyError(f"{path} cannot be written ({reason}); make its folder writable, or name another file")


def is_disk_full(error: BaseException | None) -> bool:
    """Return whether an error, or the cause of the error, is that the disk is full or a quota is used up."""
    while error is not None:
        if isinstance(error, OSError) and error.errno in (errno.ENOSPC, errno.EDQUOT):
            return True
        error = error.__cause__ or error.__context__
    return False


def _remove_abandoned(path: Path, folder: Path) -> None:
    """Remove the temporary files of ``path`` in a folder whose processes are dead."""
    pattern = re.compile(rf"\.{re.escape(path.name)}\.(\d+)\.\w+{re.escape(path.suffix)}")
    for other in folder.iterdir():
        match = pattern.fullmatch(other.name)
        if match and not is_alive(int(match[1])):
            other.unlink(missing_ok=True)


def is_alive(process: int) -> bool:
    """Return whether a process with this number is running on this machine."""
    try:
        os.kill(process, 0)
    except ProcessLookupError:
        return False
    except PermissionError:
        pass  # the process exists, but belongs to another user
    return True


def write_text(path: str | os.PathLike, text: str) -> None:
    """Write ``text`` as UTF-8, atomically."""
    with atomic_path(path) as temporary:
        temporary.write_text(text, encoding="utf-8")


def write_json(path: str | os.PathLike, value: Any) -> None:  # noqa: ANN401
    """Write ``value`` as indented JSON, atomically.

    Floats are written so that reading them returns the same number. NaN and infinity raise ValueError.
    """
    write_text(path, json.dumps(value, indent=2, allow_nan=False) + "\n")


def read_json(path: str | os.PathLike) -> Any:  # noqa: ANN401
    """Read a JSON file.

    ValueError is raised if it contains no text, no JSON, or JSON that is nested too deeply.
    """
    try:
        return json.loads(Path(path).read_text(encoding="utf-8"))
    except RecursionError as error:
        raise ValueError(f"{path} is nested too deep") from error


def read_arrays(path: str | os.PathLike) -> dict[str, Any]:
    """Return the arrays of an archive of NumPy by name; raise OSError or ValueError if it cannot be read."""
    import numpy as np  # imported here, because commands that read no archive start faster without it

    try:
        with np.load(path) as archive:
            return dict(archive)
    except (OSError, ValueError):
        raise
    except Exception as error:  # damaged archives raise many kinds of errors: zlib.error, BadZipFile, ...
        raise ValueError(f"a damaged archive, {type(error).__name__}: {error}") from error


def write_arrays(path: str | os.PathLike, arrays: Mapping[str, Any]) -> None:
    """Write arrays to an archive of NumPy by name (`read_arrays`); the file is complete or missing."""
    import numpy as np  # see `read_arrays`

    with atomic_path(path) as temporary, temporary.open("wb") as file:
        np.savez_compressed(file, **arrays)


def require_format(path: str | os.PathLike, content: Any, name: str, version: int, change: str) -> None:  # noqa: ANN401
    """Check that the entries ``format`` and ``version`` of a JSON file have the expected values.

    InputError is raised if one of the values differs, and LookupError or TypeError if the content has no such
    entries.
    """
    kind = content["format"], content["version"]
    if json.dumps(kind) != json.dumps((name, version)):  # true is equal to 1
        raise InputError(str(path), seen=f"{kind}", expected=f"{(name, version)}", change=change)


def write_csv(path: str | os.PathLike, table: "pd.DataFrame") -> None:
    """Write a table as CSV without its index.

    Floats are written with so many digits that reading them returns the same numbers. A text or a name of a
    column that a spreadsheet would run as a formula is prefixed with an apostrophe.
    """
    texts = table.select_dtypes(exclude=["number", "bool"])
    table = table.assign(**{name: texts[name].map(_no_formula) for name in texts}).rename(columns=_no_formula)
    with atomic_path(path) as temporary:
        table.to_csv(temporary, index=False, lineterminator="\n")


def _no_formula(cell: object) -> object:
    is_formula = isinstance(cell, str) and cell.startswith(FORMULA) and not is_number(cell)
    return f"'{cell}" if is_formula else cell


def is_number(cell: str) -> bool:
    """Return whether a cell of a CSV file is a number."""
    try:
        float(cell)
    except ValueError:
        return False
    return True


def content_digest(paths: Iterable[str | os.PathLike], missing: str = "") -> str:
    """Return a digest of the contents of files, in the given order.

    The names and dates of the files do not influence the digest. ``missing`` is used in place of the SHA-256
    of a file that does not exist, for example because it has not been retrieved yet. The rule that has the
    file as an input reports that it is missing.
    """
    files = [Path(path) for path in paths]
    return value_digest([file_digest(file) if file.is_file() else missing for file in files])


def file_digest(path: Path) -> str:
    """Return the SHA-256 of a file as hexadecimal digits; the file may be larger than the memory."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def value_digest(value: Any) -> str:  # noqa: ANN401
    """Return the SHA-256 of a value written as JSON; the order of mapping keys has no influence."""
    return hashlib.sha256(json.dumps(value, sort_keys=True).encode()).hexdigest()


def without_addresses(text: str) -> str:
    """Return the ``repr`` of an object without memory addresses, which differ in every process."""
    return re.sub(r"<\S*?(\w+) object at 0x\w+>", r"\1", text)


def begins_in(path: str | os.PathLike) -> str:
    """Return in words in which folder a path begins that does not exist, for the advice of a message."""
    return "" if Path(path).is_absolute() else f" Its path begins in the working folder {Path.cwd()}."


def project_file(path: str | os.PathLike, project: Path = PROJECT) -> Path:
    """Return a path that exists as it is, and otherwise the file of the project with this path, if any."""
    own = project / path
    return own if os.path.exists(own) and not os.path.exists(path) else Path(path)
