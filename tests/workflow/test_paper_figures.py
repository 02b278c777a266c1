"""A notebook that is run for a paper leaves its figures at the widths of the paper's columns."""

from pathlib import Path

from accelerated_evaluation.publishing.archive import latex_paper as paper
from accelerated_evaluation.publishing.figures.style import Print
from accelerated_evaluation.publishing.study import Study

ROOT = Path(__file__).resolve().parents[2]


def test_a_notebook_draws_its_figures_at_both_widths(finished, tmp_path):
    study = Study(finished.folder / "results" / "smoke", finished.folder / "figures" / "smoke")
    before = {path: path.stat().st_mtime_ns for path in study.figures.iterdir()}
    folders = {width: tmp_path / name for name, width in paper.WIDTHS.items()}
    notebook = ROOT / "notebooks" / "05_cross_entropy.ipynb"
    paper.draw(study, Print("STIXGeneral", folders), [notebook])
    for folder in folders.values():
        pdf = (folder / "fig03_cross_entropy_flow.pdf").read_bytes()
        assert b"STIXGeneral" in pdf
        assert b"study: smoke" in pdf
    assert {path: path.stat().st_mtime_ns for path in study.figures.iterdir()} == before
