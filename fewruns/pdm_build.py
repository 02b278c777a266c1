"""The pages of the sampler are in its wheel, in the folder fewruns/pages, where links between them work."""

from typing import Any

PAGES = "README.md", "method.md", "method_course.svg", "sampler_reference.md"


def pdm_build_update_files(context: Any, files: Any) -> None:  # noqa: ANN401
    """Add the pages to the files of a wheel."""
    if context.target == "wheel":
        files.update({f"fewruns/pages/{page}": context.root / page for page in PAGES})
