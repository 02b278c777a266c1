"""Numbers that are written as text."""


def number_in(text: str, kind: type[int] | type[float] = float) -> float:
    """Return the number that a text states; ValueError is raised if it states none.

    Unlike Python, which reads 1_0 as 10, the function refuses underscores: in a table or on a command line,
    an underscore is more likely a mistyped point or comma than a separator of digits.
    """
    if "_" in text:
        raise ValueError(f"{text!r} contains an underscore")
    return kind(text)


def counted(number: int, noun: str, plural: str = "") -> str:
    """Return a number of things as text, such as ``1 row`` or ``1,234 rows``."""
    return f"{number:,} {noun if number == 1 else plural or f'{noun}s'}"
