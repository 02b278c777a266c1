"""Notebooks run in the process of their job: what they show is kept, their texts are filled in, and an error
says where it happened.
"""

import subprocess
import sys

import nbformat
import pytest

RUN = """
import sys
from accelerated_evaluation.publishing.book.execution import run_notebook
run_notebook(sys.argv[1], {"number": 2}, sys.argv[1] + ".executed.ipynb")
"""
FILLED = "from accelerated_evaluation.publishing import texts\ntexts.fill_in_notebooks()"
SPAWN = """
from multiprocessing import get_context
get_context("spawn").Process(target=abs, args=[1]).start()
"""


def run(path, *cells, command=RUN, **metadata):
    """Run a notebook of these cells in a process of its own, which its interactive shell takes over.

    A cell that begins with a star is a text with placeholders.
    """
    parameters = nbformat.v4.new_code_cell("number = 1", metadata={"tags": ["parameters"]})
    cells = [f"%%text\n{cell}" if cell.startswith("*") else cell for cell in (FILLED, *cells)]
    cells = [parameters, *map(nbformat.v4.new_code_cell, cells)]
    metadata |= {"kernelspec": {"name": "python3", "language": "python", "display_name": "Python 3"}}
    nbformat.write(nbformat.v4.new_notebook(cells=cells, metadata=metadata), path)
    return subprocess.run(
        [sys.executable, "-c", command, str(path)], capture_output=True, text=True, check=False
    )


def test_outputs_of_all_kinds_are_kept_and_texts_filled_in_where_they_stand(tmp_path):
    """After the notebook, the process can spawn others."""
    path = tmp_path / "n.ipynb"
    figure = "import matplotlib.pyplot as plt\nplt.plot([1, number])\nplt.show()"
    markdown = (
        "from IPython.display import Markdown, display\ndisplay(Markdown('first'))\nMarkdown('**last**')"
    )
    texts = "*First* {{ number }}.", "*Then* {{ number }}."
    cells = texts[0], "print(number)", figure, markdown, "number = 3", texts[1]
    finished = run(path, *cells, command=RUN + SPAWN)
    assert finished.returncode == 0, finished.stderr
    executed = nbformat.read(f"{path}.executed.ipynb", as_version=4)
    nbformat.validate(executed)
    printed, drawn, written = [cell.outputs for cell in executed.cells if cell.cell_type == "code"][-4:-1]
    assert [output.text for output in printed] == ["2\n"]
    assert [output.data["image/png"][:5] for output in drawn] == ["iVBOR"]
    assert [output.data["text/markdown"] for output in written] == ["first", "**last**"]
    texts = [cell.source for cell in executed.cells if cell.cell_type == "markdown"]
    assert texts == ["*First* 2.", "*Then* 3."]


def test_a_text_with_an_unknown_name_is_one_error_and_leaves_nothing_behind(tmp_path):
    finished = run(tmp_path / "n.ipynb", "number", "*There are* {{ nummer }}.", "print('not reached')")
    assert finished.returncode != 0
    last = finished.stderr.strip().splitlines()[-1]
    assert "n.ipynb, cell 5: StudyError: UndefinedError: 'nummer' is undefined" in last
    assert [path.name for path in tmp_path.iterdir()] == ["n.ipynb"]


@pytest.mark.parametrize(
    ("code", "message"), [("1 / 0", "ZeroDivisionError: division"), ("1 +", "SyntaxError")]
)
def test_an_error_names_notebook_and_cell_and_leaves_nothing_behind(tmp_path, code, message):
    finished = run(tmp_path / "n.ipynb", "number", code, "print('not reached')")
    assert finished.returncode != 0
    last = finished.stderr.strip().splitlines()[-1]
    assert "n.ipynb, cell 5: " in finished.stderr
    assert message in finished.stderr
    assert "not reached" not in last
    assert [path.name for path in tmp_path.iterdir()] == ["n.ipynb"]


STUDY = """
from pathlib import Path
from accelerated_evaluation.publishing.study import Study
Path("exact.csv").write_text("segment,probability\\nall,0.1\\n")
study = Study(".", "figures")
"""


@pytest.mark.parametrize(("declared", "fails"), [(["exact.csv", "trace.csv"], False), (["trace.csv"], True)])
def test_a_notebook_may_only_read_what_it_declares(tmp_path, monkeypatch, declared, fails):
    monkeypatch.chdir(tmp_path)
    contents = {"figures": [], "tables": [], "reads": declared}
    finished = run(tmp_path / "n.ipynb", STUDY, "*{{ study.truth.probability }}*", study=contents)
    assert (finished.returncode != 0) == fails
    if fails:
        assert "n.ipynb, key study of the metadata: exact.csv not listed" in finished.stderr
        assert '"reads": ["exact.csv"]' in finished.stderr
    else:  # the executed notebook lists what was read, and not what could have been
        executed = nbformat.read(tmp_path / "n.ipynb.executed.ipynb", as_version=4)
        assert executed.metadata["study"] == {**contents, "reads": ["exact.csv"]}
