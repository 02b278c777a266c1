"""Rendered notebooks: what a hosting page shows, current, small, and the same bytes after each run."""

import base64
import re
from io import BytesIO
from pathlib import Path

import nbformat
import pytest
from accelerated_evaluation.publishing.book.execution import is_text
from accelerated_evaluation.publishing.book.rendering import LEFT_OUT, template_digest, write_rendered
from markdown_it import MarkdownIt
from mdit_py_plugins.dollarmath import dollarmath_plugin
from nbformat.v4 import new_code_cell, new_markdown_cell, new_notebook, new_output
from PIL import Image

ROOT = Path(__file__).resolve().parents[3]
NOTEBOOKS = sorted((ROOT / "notebooks").glob("*.ipynb"))
RENDERED = ROOT / "figures" / "spmd" / "notebooks"
LARGEST = 6e6  # bytes, all together


def picture(width: int = 40) -> str:
    content = BytesIO()
    Image.new("RGB", (width, 20), "red").save(content, "PNG")
    return base64.b64encode(content.getvalue()).decode()


def rendered(folder: Path, duration: float) -> nbformat.NotebookNode:
    """Return the rendered notebook of a template with a text, a figure and a table, and write its file."""
    times = {"papermill": {"duration": duration}}
    given = new_code_cell("n = 1", id="a", metadata={"tags": ["parameters"]})
    template = new_notebook(cells=[given, new_markdown_cell("{{ n }}, see [guide](../docs/g.md)", id="b")])
    data = {"image/png": picture(), "text/plain": "Figure(...)"}
    shown = [new_output("display_data", data=data), new_output("stream", text="a line\n")]
    executed = [
        new_code_cell("n = 1", id="a", metadata=given.metadata | times),
        new_code_cell("n = 2", id="c", metadata={"tags": ["injected-parameters"]}),
        new_markdown_cell("2, see [guide](../docs/g.md) and [03](03.ipynb)", id="b"),
        new_code_cell("draw()", id="d", outputs=shown, metadata=times),
    ]
    paths = [
        folder / name for name in ("notebooks/1.ipynb", "results/1.ipynb", "figures/mine/notebooks/1.ipynb")
    ]
    for path, notebook in zip(
        paths, (template, new_notebook(cells=executed, metadata=times), None), strict=True
    ):
        path.parent.mkdir(parents=True, exist_ok=True)
        if notebook:
            nbformat.write(notebook, path)
    write_rendered(*paths)
    made = nbformat.read(paths[2], as_version=4)
    assert made.metadata["template"] == template_digest(template.cells)
    return made


def test_a_rendered_notebook_has_outputs_at_screen_resolution_and_links_that_lead_somewhere(tmp_path):
    made = rendered(tmp_path, 1.0)
    nbformat.validate(made)
    assert [cell.source for cell in made.cells] == [
        "2, see [guide](../../../docs/g.md) and [03](03.ipynb)",
        "draw()",
    ]
    assert made.cells[-1].execution_count == 1
    drawn, printed = made.cells[-1].outputs
    assert list(drawn.data) == ["image/png"]
    image = Image.open(BytesIO(base64.b64decode(drawn.data["image/png"])))
    assert image.size == (20, 10)
    assert image.convert("RGB").getpixel((5, 5)) == (255, 0, 0)
    assert printed.text == "a line\n"


def test_two_runs_give_the_same_rendered_bytes(tmp_path):
    rendered(tmp_path / "one", 1.0)
    rendered(tmp_path / "two", 2.0)
    name = "figures/mine/notebooks/1.ipynb"
    assert (tmp_path / "one" / name).read_bytes() == (tmp_path / "two" / name).read_bytes()


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_the_rendered_notebooks_are_current(path):
    template, made = (nbformat.read(folder / path.name, as_version=4) for folder in (path.parent, RENDERED))
    change = "run make study, which renders the notebooks again"
    shown = [cell for cell in template.cells if not LEFT_OUT & set(cell.metadata.get("tags", []))]
    code = [cell.source for cell in shown if cell.cell_type == "code" and not is_text(cell)]
    assert code == [cell.source for cell in made.cells if cell.cell_type == "code"], change
    assert made.metadata["template"] == template_digest(template.cells), change
    texts = " ".join(cell.source for cell in made.cells if cell.cell_type == "markdown")
    assert not re.search(r"\{%|\{\{", texts)
    outputs = [output for cell in made.cells for output in cell.get("outputs", [])]
    assert outputs
    figures = [
        at for at, each in enumerate(outputs) if "published" in each.get("metadata", {}).get("image/png", {})
    ]
    for above, picture, below in (outputs[at - 1 : at + 2] for at in figures):
        number, title = re.fullmatch(
            r"<a.*</a>\s*\*\*(Figure \d+)\.(.*)\*\*", above.data["text/markdown"]
        ).groups()
        assert path.stem > "9" or 2 <= len(title.split(" ")) <= 13, number  # twelve words behind a blank
        assert len(picture.metadata["image/png"]["alt"]) > 20, number
        assert len(below.data["text/markdown"]) > 100, number


@pytest.mark.parametrize("path", sorted(RENDERED.glob("*.ipynb")), ids=lambda path: path.stem)
def test_every_formula_of_the_rendered_texts_is_set(path):
    markdown = MarkdownIt("commonmark").enable("table").use(dollarmath_plugin)  # as in the book
    for cell in nbformat.read(path, as_version=4).cells:
        if cell.cell_type == "markdown":
            inline = [part for token in markdown.parse(cell.source) for part in token.children or []]
            texts = [part.content for part in inline if part.type == "text"]
            assert not [text for text in texts if "$" in text], cell.id


def test_the_rendered_notebooks_are_small_and_name_no_folder_of_the_machine():
    paths = sorted(RENDERED.glob("*.ipynb"))
    assert [path.name for path in paths] == [path.name for path in NOTEBOOKS]
    assert sum(path.stat().st_size for path in paths) < LARGEST
    for path in paths:
        without_images = re.sub(r'"image/png": "[^"]*"', "", path.read_text(encoding="utf-8"))
        assert not re.search(r"""["' (=](/[A-Za-z][\w.-]*){2,}""", without_images), path.name
