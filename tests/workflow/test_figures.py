"""Every figure of a study is legible and distinguishable in grey, and repeats its bytes."""

import json
import subprocess
import sys
from pathlib import Path

CHECKS = Path(__file__).resolve().parents[1] / "unit" / "figure_checks.py"


def test_no_figure_of_a_study_has_a_defect(finished):
    """The process imports the library of the finished study, with its toys."""
    done = subprocess.run(
        [sys.executable, str(CHECKS), "results/smoke", "figures/smoke"],
        cwd=finished.folder,
        env=finished.environment,
        capture_output=True,
        text=True,
    )
    assert done.returncode == 0, done.stderr[-3000:]
    found = json.loads(done.stdout)
    published = {path.stem for path in (finished.folder / "figures/smoke").glob("*.png")}
    assert set(found) == published
    assert {name: defects for name, defects in found.items() if defects} == {}
