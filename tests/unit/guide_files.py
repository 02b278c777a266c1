"""Files that guides show in full, and a folder in which their commands run on fewer records."""

import re
from collections.abc import Callable
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]


def text_of(*names: str) -> str:
    """Return the text of guides, one after the other."""
    return "\n".join((ROOT / "docs" / f"{name}.md").read_text() for name in names)


def files_in(text: str) -> dict[str, str]:
    """Return the files that a guide shows, by name."""
    return dict(re.findall(r"^File `([^`]+)`:\n\n```\w+\n(.*?)^```$", text, re.DOTALL | re.MULTILINE))


def clone_of(files: dict[str, str]) -> Callable:
    """Return a fixture: a folder with files, the settings of a small estimate, and a link to the records."""

    @pytest.fixture
    def clone(tmp_path, monkeypatch):
        monkeypatch.chdir(tmp_path)
        for name, content in files.items():
            Path(name).write_text(content)
        settings = "data: {sample: 3000, spmd: {outlier_rows: []}}\nsurrogate: {maximum_calls: 100}\n"
        Path("fewer.yaml").write_text(settings)
        Path("data").symlink_to(ROOT / "data")
        return tmp_path

    return clone
