"""Texts with placeholders: Markdown into which the values of variables are inserted.

Placeholders have the syntax of Jinja: a name or an expression, and a filter for the format of a number::

    The search takes {{ simulations | number }} simulations, {{ share | percent }} of all.
    {% if crashed %}Half of the crashes end below {{ speed | readable(2) }} m/s.{% endif %}

An inserted text is not interpreted as Markdown: its special characters, such as a dollar sign or a tag in the
description of a data set, are escaped. The filter ``safe`` inserts a text as Markdown.
"""

import math
from collections.abc import Mapping
from pathlib import Path
from types import SimpleNamespace
from typing import Any

from jinja2 import Environment, StrictUndefined
from markupsafe import Markup

from accelerated_evaluation.base.errors import StudyError
from accelerated_evaluation.publishing.tables.formats import as_markdown, readable


def number(value: float, decimals: int = 0, sign: str = "") -> str:
    """Write a number with a fixed number of decimals, such as 1,234.5.

    NaN is written as a dash, and infinity as ∞. A ``"+"`` as sign writes the sign of positive numbers too.
    """
    return f"{value:{sign},.{decimals}f}" if math.isfinite(value) else readable(float(value))


def percent(value: float, decimals: int = 0, sign: str = "") -> str:
    """Write a share between 0 and 1 as a percentage, such as 12.3%.

    Parameters
    ----------
    value
        The share.
    decimals
        Digits after the point.
    sign
        ``"+"`` writes the sign of positive numbers too.
    """
    return f"{number(100 * value, decimals, sign)}%" if math.isfinite(value) else readable(float(value))


def unbroken(value: Any, digits: int = 3) -> Any:  # noqa: ANN401
    """Write a number as `readable` does, with non-breaking spaces, so that it stays on one line."""
    written = readable(value, digits)
    return written.replace(" ", "\N{NO-BREAK SPACE}") if isinstance(written, str) else written


def fill(text: str, names: Mapping[str, Any]) -> str:
    """Return a Markdown text with its placeholders of Jinja filled in.

    StudyError is raised if a placeholder uses an unknown name, or its expression fails.
    """
    try:
        return _ENVIRONMENT.from_string(text).render(names)
    except Exception as error:
        # The message of a KeyError is only the key, so the type of the error is written too.
        raise StudyError(f"{type(error).__name__}: {error}") from error


def caption(folder: Path, name: str, config: Mapping[str, Any]) -> list[str]:
    """Return the paragraphs of the caption of a figure or table, with its placeholders filled in.

    The Snakemake report reads the same files, ``<name>.rst``, so their placeholders use the configuration by
    the name ``snakemake.config``.
    """
    text = (folder / f"{name}.rst").read_text(encoding="utf-8")
    return fill(text, {"snakemake": SimpleNamespace(config=config)}).strip().split("\n\n")


def _escaped(value: Any) -> Any:  # noqa: ANN401
    """Escape a string, unless the filter ``safe`` has marked it."""
    return value if isinstance(value, Markup) else as_markdown(value)


_ENVIRONMENT = Environment(
    undefined=StrictUndefined, finalize=_escaped, trim_blocks=True, lstrip_blocks=True, autoescape=False
)
_ENVIRONMENT.filters |= {"number": number, "percent": percent, "readable": unbroken}
