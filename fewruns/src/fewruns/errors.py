"""The error for an input that cannot be used."""

from functools import partial


class InputError(ValueError):
    """An input that cannot be used, such as a damaged file or a table of another problem.

    Parameters
    ----------
    where, seen, expected, change
        Path of the file or name of the argument, what was found there, what was expected, and what to do.

    Examples
    --------
    >>> raise InputError("batch_size", seen="0", expected="1 to 500", change="Choose another size.")
    Traceback (most recent call last):
    ...
    fewruns.errors.InputError: batch_size: seen 0; expected 1 to 500. Choose another size.
    """

    def __init__(self, where: str, *, seen: str, expected: str, change: str) -> None:
        self.where, self.seen, self.expected, self.change = where, seen, expected, change
        super().__init__(f"{where}: seen {seen}; expected {expected}. {change}")

    def __reduce__(self) -> tuple:
        """Pickle by keyword, so that the error survives a process boundary."""
        return partial(type(self), seen=self.seen, expected=self.expected, change=self.change), (self.where,)


def require(
    name: str, value: object, expected: str, *, fits: bool, change: str = "Choose another value."
) -> None:
    """Raise InputError if an argument does not fit what is expected."""
    if not fits:
        raise InputError(name, seen=f"{value!r:.80}", expected=expected, change=change)
