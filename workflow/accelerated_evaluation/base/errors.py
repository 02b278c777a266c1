"""Errors that a user can correct. Each message says where, what was seen and expected, and what to change."""

import errno
from collections.abc import Iterator
from contextlib import contextmanager

FORBIDDEN = (errno.EACCES, errno.EPERM, errno.EROFS)
# Errors of code that reads contents which are not what it expects.
DAMAGE = (ArithmeticError, AttributeError, LookupError, TypeError, ValueError)


class StudyError(Exception):
    """An error that a user of the study can correct; scripts and commands print it without a traceback.

    Examples
    --------
    >>> import accelerated_evaluation as ae
    >>> issubclass(ae.InputError, ae.StudyError)
    True
    """


class InputError(StudyError):
    """An input that cannot be used: a file, row, column or configuration key.

    Parameters
    ----------
    where
        File and row, column or configuration key.
    seen, expected
        What was found there, and what was expected.
    change
        What the user can do about it.

    Examples
    --------
    >>> import accelerated_evaluation as ae
    >>> try:
    ...     ae.read_law("missing.json")
    ... except ae.InputError as error:
    ...     print(error.where)
    missing.json
    """

    def __init__(self, where: str, *, seen: str, expected: str, change: str) -> None:
        self.where, self.seen, self.expected, self.change = where, seen, expected, change
        super().__init__(f"{where}: seen {seen}; expected {expected}. {change}")

    def __reduce__(self) -> tuple:
        """Pickle by keyword, so that the error survives a process boundary."""
        return _rebuild_input_error, (self.where, self.seen, self.expected, self.change)


class ConvergenceError(StudyError):
    """An iterative calculation that ended before it met its convergence criterion.

    The message says which value it ``reached``, which ``limit`` it should have met, and what to change.
    """

    def __init__(self, what: str, *, reached: str, limit: str, change: str) -> None:
        self.what, self.reached, self.limit, self.change = what, reached, limit, change
        super().__init__(f"{what} did not converge: reached {reached}; limit {limit}. {change}")


@contextmanager
def located(place: str) -> Iterator[None]:
    """Prefix the message of an `InputError` or `ConvergenceError` in the block by a place.

    The place, such as a segment or file, is where the error occurred, which only the caller knows.
    """
    try:
        yield
    except InputError as error:
        raise InputError(
            f"{place}, {error.where}", seen=error.seen, expected=error.expected, change=error.change
        ) from error
    except ConvergenceError as error:
        raise ConvergenceError(
            f"{place}, {error.what}", reached=error.reached, limit=error.limit, change=error.change
        ) from error


@contextmanager
def readable(
    where: str, expected: str, change: str, errors: tuple[type[Exception], ...] = DAMAGE
) -> Iterator[None]:
    """Raise InputError if one of the ``errors`` is raised in the block.

    The other arguments are as in `InputError`.
    """
    try:
        yield
    except errors as error:
        seen = f"{type(error).__name__}: {error}"
        raise InputError(where, seen=seen, expected=expected, change=change) from error


def forbidden(path: str) -> InputError:
    """Return the error for a file or folder that the user has no permission to read, write or list."""
    return InputError(
        path,
        seen="no permission to use it",
        expected="permission to read it, and to write it if it holds results",
        change="Change its permissions or its owner (chmod, chown), or name another file or folder.",
    )


def explained(error: Exception) -> Exception:
    """Return an `InputError` that explains a missing file permission; return any other error unchanged."""
    if isinstance(error, OSError) and error.errno in FORBIDDEN and error.filename:
        return forbidden(error.filename)
    return error


def unusable(error: Exception) -> Exception:
    """Return an `InputError` that names the file or folder that cannot be used.

    An error that does not concern a file is returned unchanged.
    """
    cause = explained(error)
    if not isinstance(cause, OSError) or not cause.filename:
        return cause
    return InputError(
        str(cause.filename),
        seen=f'"{cause.strerror}"',
        expected="a file that can be read, or a folder in which files can be made",
        change="Name another file or folder.",
    )


def _rebuild_input_error(where: str, seen: str, expected: str, change: str) -> InputError:
    return InputError(where, seen=seen, expected=expected, change=change)
