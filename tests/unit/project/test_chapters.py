"""The code of the chapters, which only a whole study runs."""

import ast
import importlib
import json
from pathlib import Path

import pytest

CHAPTERS = sorted((Path(__file__).resolve().parents[3] / "notebooks").glob("*.ipynb"))


def imported(chapter):
    """Yield module and name of everything that the cells of a chapter import by name."""
    for cell in json.loads(chapter.read_text(encoding="utf-8"))["cells"]:
        code = "".join(cell["source"])
        if cell["cell_type"] == "code" and not code.startswith("%%"):
            for node in ast.walk(ast.parse(code)):
                if isinstance(node, ast.ImportFrom):
                    yield from ((node.module, each.name) for each in node.names)


@pytest.mark.parametrize("chapter", CHAPTERS, ids=lambda path: path.stem)
def test_every_name_that_a_chapter_imports_exists(chapter):
    names = list(imported(chapter))
    assert names
    missing = [name for module, name in names if not hasattr(importlib.import_module(module), name)]
    assert not missing
