"""The text of the article: which published figures it shows, and which benchmarks it quotes.

The Snakefile needs both before any job runs. This module therefore imports no package that loads slowly.
"""

import re
from pathlib import Path

TEXT = "article.typ"
BENCHMARKS = (
    "worlds",
    "worlds_beyond",
    "samplers",
    "successors",
    "answers",
)  # tables in benchmarks/results that the text quotes
_SHOWN = re.compile(r'plot\("(\w+)"')


def shown_figures(folder: Path) -> tuple[str, ...]:
    """Return the names of the figures that the text in a folder shows, in order."""
    return tuple(dict.fromkeys(_SHOWN.findall((folder / TEXT).read_text(encoding="utf-8"))))
