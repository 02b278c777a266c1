"""The sampler is a package of its own: it imports nothing of the study."""

import re
import subprocess
import sys
from pathlib import Path

SOURCE = Path(__file__).resolve().parents[1] / "src" / "fewruns"


def test_the_sampler_imports_nothing_of_the_study():
    sources = {path: path.read_text() for path in SOURCE.glob("*.py")}
    assert sources
    for path, source in sources.items():
        assert not re.search(r"^\s*(from|import) accelerated_evaluation", source, re.MULTILINE), path


def test_importing_all_public_names_loads_neither_pandas_nor_scipy_stats():
    code = "from fewruns import *; import sys; sys.exit(bool({'pandas', 'scipy.stats'} & sys.modules.keys()))"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0
