"""What a LaTeX paper takes of a study: numbers as macros, figures as wide as its columns, an example."""

import re
import shutil
import subprocess
from pathlib import Path

import matplotlib.pyplot as plt
import pandas as pd
import pytest
from accelerated_evaluation.base.errors import InputError
from accelerated_evaluation.publishing import latex_paper as paper
from accelerated_evaluation.publishing.figures.style import Print, paper_style, printed, save_figure
from accelerated_evaluation.publishing.study import Study
from printed_figures import write_pdf

ROOT = Path(__file__).resolve().parents[2]
ORIGIN = {"study": "my_study", "commit": "01" * 20, "configuration": "ab" * 32}


@pytest.fixture
def claims():
    return pd.read_csv(ROOT / "figures" / "spmd" / "tables" / "claims.csv")


def test_each_number_has_a_macro(claims):
    named = pd.read_csv(ROOT / "figures" / "spmd" / "numbers.csv")
    lines = paper.numbers(claims, named, ORIGIN).splitlines()[1:]
    macros = dict(re.fullmatch(r"\\newcommand\{\\([A-Za-z]+)\}\{(.*)\}", line).groups() for line in lines)
    assert len(macros) == len(lines) == 4 * len(claims) + len(named) + len(ORIGIN)
    assert macros["SecondSize"] == "146,054"
    assert "AnswerLowEightZero" in macros
    assert macros["CrashProbabilityOfOneLaneChangePaper"] == r"7.4 $\times$ 10$^{-7}$"
    assert macros["SimulationsToConvergePiecewiseMeanPaper"] == "7,840"
    assert macros["StudyStudy"] == r"my\_study"


def test_claims_of_the_same_words_are_refused(claims):
    twice = pd.concat([claims, claims.head(1).assign(claim="Crash-probability of one lane change!")])
    with pytest.raises(InputError, match="CrashProbabilityOfOneLaneChange"):
        paper.numbers(twice, pd.DataFrame({"name": [], "value": []}), ORIGIN)


def test_figures_have_the_widths_of_the_columns_and_the_font_of_the_text(tmp_path):
    folders = {width: tmp_path / name for name, width in paper.WIDTHS.items()}
    with printed(Print("STIXGeneral", folders)), paper_style():
        drawn, axes = plt.subplots(figsize=(3.5, 2.0))
        axes.set_xlabel("a label")
        save_figure(drawn, pd.DataFrame({"x": [1]}), tmp_path / "plain", "fig01")
    for width, folder in folders.items():
        pdf = (folder / "fig01.pdf").read_bytes()
        box = [float(number) for number in re.search(rb"/MediaBox \[ ([\d. ]+) \]", pdf)[1].split()]
        assert box[2:] == pytest.approx([72 * width, 72 * 2.0], abs=0.1)
        assert b"STIXGeneral" in pdf
    assert {path.name for path in (tmp_path / "plain").iterdir()} == {"fig01.png", "fig01.csv"}
    with paper_style():
        assert plt.rcParams["font.serif"] == ["DejaVu Serif"]


def test_a_font_that_is_not_installed_is_refused_before_anything_is_written(tmp_path):
    with pytest.raises(InputError, match="No Such Font"):
        paper.write_paper(Study(tmp_path, tmp_path), tmp_path / "paper", "No Such Font")
    assert not (tmp_path / "paper").exists()


def test_the_example_compiles_to_two_pages(tmp_path, monkeypatch):
    """The figures are those of the study as they are, because drawing them anew takes a minute."""
    latex = shutil.which("pdflatex")
    if latex is None or not shutil.which("kpsewhich") or not kpsewhich("IEEEtran.cls"):
        pytest.skip("no pdflatex with IEEEtran: texlive-latex-recommended, texlive-publishers")
    target, figures = tmp_path / "paper", ROOT / "figures" / "spmd"

    def draw(study, settings, notebooks):
        assert len(notebooks) >= 8
        for folder in settings.folders.values():
            folder.mkdir(parents=True)
            for path in figures.glob("fig*.png"):
                write_pdf(path.stem, folder)

    (tmp_path / "config.json").write_text('{"study": "spmd"}')
    monkeypatch.setattr(paper, "draw", draw)
    paper.write_paper(Study(tmp_path, figures), target, "STIXGeneral")
    for _ in range(2):
        run = subprocess.run(
            [latex, "-interaction=nonstopmode", "-halt-on-error", "example.tex"],
            cwd=target,
            capture_output=True,
            text=True,
            errors="replace",
        )
    assert run.returncode == 0, run.stdout[-3000:]
    assert "undefined" not in run.stdout
    assert "(2 pages" in run.stdout


def kpsewhich(name: str) -> str:
    """Return where TeX finds a file, empty if it does not."""
    return subprocess.run(["kpsewhich", name], capture_output=True, text=True).stdout.strip()
