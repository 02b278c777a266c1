"""Files that guides show in full, and a folder in which their commands run on fewer records."""

import re
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]


def text_of(*names: str) -> str:
    """Return the text of guides, one after the other."""
    return "\n".join((ROOT / "docs" / f"{name}.md").read_text() for name in names)


def files_in(text: str) -> dict[str, str]:
    """Return the files that a guide shows, by name."""
    return dict(re.findall(r"^File `([^`]+)`:\n\n```\w+\n(.*?)^```$", text, re.DOTALL | re.MULTILINE))


def write_all(files: dict[str, str]) -> None:
    """Write files into the working folder, the settings of a small estimate, and a link to the records."""
    for name, content in files.items():
        Path(name).write_text(content)
    settings = "data: {sample: 3000, spmd: {outlier_rows: []}}\nsurrogate: {maximum_calls: 100}\n"
    Path("fewer.yaml").write_text(settings)
    Path("data").symlink_to(ROOT / "data")
