"""The README, the pages of the benchmarks and the guides show the published numbers, and nothing else."""

import re
from pathlib import Path

import pandas as pd
import pytest
from accelerated_evaluation.publishing.pages import filled, names_of_pages, templates

ROOT = Path(__file__).resolve().parents[3]
TABLES, RESULTS = ROOT / "figures" / "spmd" / "tables", ROOT / "benchmarks" / "results"
GUIDES = ("docs", "fewruns")  # folders
README, LINES = ROOT / "README.md", 120
PAGES = [
    *ROOT.glob("*.md"),
    *ROOT.glob("docs/*.md"),
    *ROOT.glob("fewruns/**/*.md"),
    *ROOT.glob("benchmarks/**/*.md"),
]
# Pages with numbers of a benchmark, and its table.
BENCHMARKS = {
    "vehicles": "benchmarks/samplers/details.md",
    "exported": "docs/export.md",
    "answers": "benchmarks/answers/README.md",
}
DEPLOYMENTS = "../../deployments/github-pages"  # on the hosting page of the repository


@pytest.fixture(scope="module")
def names():
    return names_of_pages(ROOT)


@pytest.mark.skipif(not TABLES.exists(), reason="the tables of the real events are not in this copy")
@pytest.mark.parametrize("template", templates(ROOT), ids=lambda path: str(path.relative_to(ROOT)))
def test_a_page_shows_the_published_numbers(template, names):
    page = template.with_suffix("").read_text(encoding="utf-8")
    assert page == filled(template, names), "edit the template, then run make pages"


def test_a_page_names_its_template_and_has_no_other_comment(tmp_path):
    template = tmp_path / "a.md.in"
    template.write_text("# {{ n }}\n| {{ n | number(1) }} |\n")
    assert filled(template, {"n": 2}) == (
        "<!-- Made from a.md.in by `make pages`; edit that file. -->\n\n# 2\n| 2.0 |\n"
    )
    made = [path for path in PAGES if path.read_text(encoding="utf-8").startswith("<!-- Made from")]
    assert sorted(made) == [path.with_suffix("") for path in templates(ROOT)]
    assert all(path.read_text(encoding="utf-8").count("<!--") == 1 for path in made)


def test_the_example_of_the_library_runs(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    guide = (
        (ROOT / "docs" / "your_vehicle.md")
        .read_text(encoding="utf-8")
        .split("## From your own Python code")[1]
    )
    (example,) = re.findall(r"```python\n(.*?)```", guide, re.DOTALL)
    names = {}
    exec(example, names)
    found = names["found"]
    assert found.converged
    assert (tmp_path / "state.json").exists()
    assert 0 < found.low < found.probability < found.high < 1e-3


@pytest.mark.parametrize("path", PAGES, ids=lambda path: str(path.relative_to(ROOT)))
def test_every_row_of_a_table_has_as_many_cells_as_its_head(path):
    cells = 0
    for line in path.read_text(encoding="utf-8").splitlines():
        row = line.replace("\\|", "").count("|") if line.startswith("|") else 0
        assert not cells or row in (0, cells), line
        cells = row


@pytest.mark.skipif(not TABLES.exists(), reason="the tables of the real events are not in this copy")
def test_the_benchmarks_are_of_the_present_laws_or_say_that_they_are_older():
    laws = pd.read_csv(TABLES / "laws.csv").iloc[1:].set_index("law")
    heaviest = laws["weight"].idxmax()
    exact = pd.read_csv(RESULTS / "vehicles.csv").query("vehicle == 'acc_aeb'").set_index("law")["exact"]
    exported = pd.read_csv(RESULTS / "exported.csv").set_index("vehicle")["exact"]
    answer = pd.read_csv(TABLES / "answer.csv").set_index("event").loc["crash"]
    runs = pd.read_csv(RESULTS / "answers_runs.csv").set_index("vehicle")
    found = {
        "vehicles": [
            (exact["answer"], laws.loc[heaviest, "probability"]),
            (exact["two_kinds"], laws.loc["two kinds 0.98", "probability"]),
            (exact["hazard"], laws.loc["hazard", "probability"]),
        ],
        "exported": [(exported["acc_aeb"], laws.loc[heaviest, "probability"])],
        "answers": [
            (runs.loc["acc_aeb", f"map_{end}"].iloc[0], answer[end]) for end in ("low80", "median", "high80")
        ],
    }
    for name, pairs in found.items():
        present = all(stated == pytest.approx(expected, rel=0.05) for stated, expected in pairs)
        text = " ".join((ROOT / BENCHMARKS[name]).read_text(encoding="utf-8").split())
        assert present != ("made before the factors of the far tail varied by place" in text), name


def test_the_readme_is_two_screens():
    assert len(README.read_text(encoding="utf-8").splitlines()) <= LINES


@pytest.mark.parametrize("path", PAGES, ids=lambda path: str(path.relative_to(ROOT)))
def test_links_lead_to_files_and_headings(path):
    text = re.sub(r"```.*?```|`[^`]*`", "", path.read_text(encoding="utf-8"), flags=re.DOTALL)
    for link in re.findall(r"\]\(([^)\s]+)\)", text):
        if "://" in link or link == DEPLOYMENTS:
            continue
        name, _, anchor = link.partition("#")
        target = (path.parent / name).resolve() if name else path
        assert target.exists(), link
        # A guide is a chapter of the book, which has no other pages.
        assert path.parent.name not in GUIDES or target.parent.name in (*GUIDES, "notebooks"), link
        if anchor:
            headings = re.findall(r"^#+ (.+)$", target.read_text(encoding="utf-8"), re.MULTILINE)
            assert anchor in {
                re.sub(r"[^\w\- ]", "", heading.lower()).replace(" ", "-") for heading in headings
            }, link
