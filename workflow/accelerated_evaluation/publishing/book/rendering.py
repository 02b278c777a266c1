"""The executed notebook of a chapter, written for reading: smaller pictures, and links from its folder."""

import os
import re
from base64 import b64decode, b64encode
from collections.abc import Sequence
from io import BytesIO
from pathlib import Path

from PIL import Image

from accelerated_evaluation.base.files import value_digest, write_text
from accelerated_evaluation.study.jobs import without

with without("rfc3987_syntax"):
    import nbformat
    from nbformat import NotebookNode

SCALE = 0.5  # of figures: 150 instead of 300 pixels per inch
COLOURS = 128
LEFT_OUT = {"parameters", "injected-parameters", "imports"}  # tags of cells that prepare the others
LINK_TO_FILE = re.compile(r"(?<=\]\()\.\.[^)#\s]*")


def write_rendered(notebook: Path, executed: Path, rendered: Path) -> None:
    """Write an executed notebook for reading; links to files are changed to lead there from its folder.

    The cells with parameters and imports are left out, so that the first picture is near the title, and
    so are texts that are empty in this study.
    """
    template, made = (nbformat.read(path, as_version=4) for path in (notebook, executed))
    for cell in made.cells:
        cell.metadata.pop("papermill", None)
        if cell.cell_type == "markdown":
            cell.source = LINK_TO_FILE.sub(
                lambda link: os.path.relpath(notebook.parent / link[0], rendered.parent), cell.source
            )
        for output in cell.get("outputs", []):
            if picture := output.get("data", {}).get("image/png"):
                output.data = {"image/png": _smaller(picture)}
    made.cells = [
        cell for cell in made.cells if cell.source and not LEFT_OUT & set(cell.metadata.get("tags", []))
    ]
    for number, cell in enumerate((cell for cell in made.cells if cell.cell_type == "code"), start=1):
        cell.execution_count = number
    made.metadata = {
        key: value for key, value in made.metadata.items() if key in ("kernelspec", "language_info", "study")
    } | {"template": template_digest(template.cells)}
    write_text(rendered, nbformat.writes(made) + "\n")


def template_digest(cells: Sequence[NotebookNode]) -> str:
    """Return the SHA-256 of the sources of the cells of a notebook."""
    return value_digest([cell.source for cell in cells])


def _smaller(picture: str) -> str:
    """Return a PNG image in Base64 at screen resolution and with a palette, which is a third of the size."""
    image = Image.open(BytesIO(b64decode(picture)))
    size = tuple(round(SCALE * pixels) for pixels in image.size)
    smaller = BytesIO()
    image = image.convert("RGB").resize(size, Image.Resampling.LANCZOS).quantize(COLOURS)
    image.save(smaller, "PNG", optimize=True)
    return b64encode(smaller.getvalue()).decode()
