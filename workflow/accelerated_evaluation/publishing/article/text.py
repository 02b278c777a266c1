"""The text of the article: a template in the language of Typst."""

import re
from pathlib import Path

TEXT = "article.typ"
_SHOWN = re.compile(r'plot\("(\w+)"')


def shown_figures(folder: Path) -> tuple[str, ...]:
    """Return the names of the figures that the text in a folder shows, in order."""
    return tuple(dict.fromkeys(_SHOWN.findall((folder / TEXT).read_text(encoding="utf-8"))))
