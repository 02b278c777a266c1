"""Notebooks run in the process of their job: what they show is kept, and an error says where it happened."""

import subprocess
import sys

import nbformat
import pytest

RUN = """
import sys
from accelerated_evaluation.publishing.execution import run_notebook
run_notebook(sys.argv[1], {"number": 2}, sys.argv[1] + ".executed.ipynb", sys.argv[1] + ".html")
"""


def run(path, *cells):
    """Run a notebook of these cells in a process of its own, which its interactive shell takes over."""
    parameters = nbformat.v4.new_code_cell("number = 1", metadata={"tags": ["parameters"]})
    cells = [parameters, *map(nbformat.v4.new_code_cell, cells)]
    metadata = {"kernelspec": {"name": "python3", "language": "python", "display_name": "Python 3"}}
    nbformat.write(nbformat.v4.new_notebook(cells=cells, metadata=metadata), path)
    return subprocess.run([sys.executable, "-c", RUN, str(path)], capture_output=True, text=True, check=False)


def test_outputs_of_all_kinds_are_kept_and_rendered(tmp_path):
    path = tmp_path / "n.ipynb"
    figure = "import matplotlib.pyplot as plt\nplt.plot([1, number])\nplt.show()"
    markdown = (
        "from IPython.display import Markdown, display\ndisplay(Markdown('first'))\nMarkdown('**last**')"
    )
    finished = run(path, "print(number)", figure, markdown)
    assert finished.returncode == 0, finished.stderr
    executed = nbformat.read(f"{path}.executed.ipynb", as_version=4)
    nbformat.validate(executed)
    printed, drawn, written = [cell.outputs for cell in executed.cells if cell.cell_type == "code"][-3:]
    assert [output.text for output in printed] == ["2\n"]
    assert [output.data["image/png"][:5] for output in drawn] == ["iVBOR"]
    assert [output.data["text/markdown"] for output in written] == ["first", "**last**"]
    html = (tmp_path / "n.ipynb.html").read_text()
    assert "<strong>last</strong>" in html
    assert "data:image/png;base64,iVBOR" in html


@pytest.mark.parametrize(
    ("code", "message"), [("1 / 0", "ZeroDivisionError: division"), ("1 +", "SyntaxError")]
)
def test_an_error_names_notebook_and_cell_and_leaves_nothing_behind(tmp_path, code, message):
    finished = run(tmp_path / "n.ipynb", "number", code, "print('not reached')")
    assert finished.returncode != 0
    last = finished.stderr.strip().splitlines()[-1]
    assert "n.ipynb, cell 4: " in finished.stderr
    assert message in finished.stderr
    assert "not reached" not in last
    assert [path.name for path in tmp_path.iterdir()] == ["n.ipynb"]
