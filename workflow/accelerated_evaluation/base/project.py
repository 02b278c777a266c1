"""Files outside this package: the default configuration, its schema, and the records of the project.

In a copy of the repository they are in the folders ``config``, ``data`` and ``workflow``. A wheel contains
these folders as ``accelerated_evaluation/project``, see ``pyproject.toml``.
"""

import os
from pathlib import Path

_LIBRARY = Path(__file__).resolve().parents[1]
_PACKAGED = _LIBRARY / "project"
PROJECT = _PACKAGED if _PACKAGED.is_dir() else _LIBRARY.parents[1]


def project_file(path: str | os.PathLike, project: Path = PROJECT) -> Path:
    """Return a path that exists as it is, and otherwise the file of the project with this path, if any."""
    own = project / path
    return own if own.exists() and not Path(path).exists() else Path(path)
