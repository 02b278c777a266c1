"""The pages of the sampler are in its wheel, in the folder fewruns/pages, where links between them work.

The description in the metadata is the guide without links to files, which would be broken on a package index.
"""

import re
from typing import Any

PAGES = "README.md", "method.md", "method_course.svg", "sampler_reference.md"
LINK_TO_FILE = re.compile(r"\[([^]]+)\]\((?!https?:|#)[^)]+\)")


def pdm_build_initialize(context: Any) -> None:  # noqa: ANN401
    """Take the description from the guide; a link to a file becomes its text."""
    text = LINK_TO_FILE.sub(r"\1", (context.root / "README.md").read_text(encoding="utf-8"))
    context.config.metadata["readme"] = {"content-type": "text/markdown", "text": text}


def pdm_build_update_files(context: Any, files: Any) -> None:  # noqa: ANN401
    """Add the pages to the files of a wheel."""
    if context.target == "wheel":
        files.update({f"fewruns/pages/{page}": context.root / page for page in PAGES})
