"""The sampler is a package of its own: it imports nothing of the study."""

import re
import shutil
import subprocess
import sys
from pathlib import Path
from zipfile import ZipFile

import pytest

SOURCE = Path(__file__).resolve().parents[1] / "src" / "fewruns"


def test_the_sampler_imports_nothing_of_the_study():
    sources = {path: path.read_text() for path in SOURCE.glob("*.py")}
    assert sources
    for path, source in sources.items():
        assert not re.search(r"^\s*(from|import) accelerated_evaluation", source, re.MULTILINE), path


def test_importing_all_public_names_loads_neither_pandas_nor_scipy_stats():
    code = "from fewruns import *; import sys; sys.exit(bool({'pandas', 'scipy.stats'} & sys.modules.keys()))"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


def test_the_wheel_contains_the_pages_with_all_pages_that_they_link_to(tmp_path, monkeypatch):
    backend = pytest.importorskip("pdm.backend", reason="needs the extra dev")
    monkeypatch.chdir(shutil.copytree(SOURCE.parents[1], tmp_path / "fewruns"))
    wheel = ZipFile(tmp_path / backend.build_wheel(str(tmp_path)))
    pages = {Path(name).name for name in wheel.namelist() if name.startswith("fewruns/pages/")}
    linked = re.findall(r"\]\((\w+\.\w+)", wheel.read("fewruns/pages/README.md").decode())
    assert {"method.md", "sampler_reference.md"} <= set(linked) <= pages
    (metadata,) = [name for name in wheel.namelist() if name.endswith("METADATA")]
    assert set(re.findall(r"\]\((.)", wheel.read(metadata).decode())) == {"#"}  # no file, for a package index
