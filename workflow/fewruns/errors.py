"""The error for an input that cannot be used."""


class InputError(ValueError):
    """An input that cannot be used, such as a damaged file or a table of another problem.

    Parameters
    ----------
    where
        The input: the path of a file, or the name of an argument.
    seen, expected
        What was found there, and what was expected.
    change
        What the user can do about it.

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
