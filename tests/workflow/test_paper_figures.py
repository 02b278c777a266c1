"""A notebook that is run for a paper leaves its figures at the widths of the paper's columns."""

import subprocess
import sys

# In a process of its own, which imports the library of the finished study, with its toys.
DRAW = """
import sys
from pathlib import Path
from accelerated_evaluation.publishing import latex_paper as paper
from accelerated_evaluation.publishing.figures.style import Print
from accelerated_evaluation.publishing.study import Study
study = Study("results/smoke", "figures/smoke")
folders = {width: Path(sys.argv[1]) / name for name, width in paper.WIDTHS.items()}
paper.draw(study, Print("STIXGeneral", folders), [Path("notebooks/92_figures_of_the_paper.ipynb")])
"""


def test_a_notebook_draws_its_figures_at_both_widths(finished, tmp_path):
    figures = finished.folder / "figures" / "smoke"
    before = {path: path.stat().st_mtime_ns for path in figures.iterdir()}
    done = subprocess.run(
        [sys.executable, "-c", DRAW, str(tmp_path)],
        cwd=finished.folder,
        env=finished.environment,
        capture_output=True,
        text=True,
    )
    assert done.returncode == 0, done.stderr[-3000:]
    folders = list(tmp_path.iterdir())
    assert len(folders) == 2
    for folder in folders:
        pdf = (folder / "fig03_cross_entropy_flow.pdf").read_bytes()
        assert b"STIXGeneral" in pdf
        assert b"of the study smoke" in pdf
    assert {path: path.stat().st_mtime_ns for path in figures.iterdir()} == before
