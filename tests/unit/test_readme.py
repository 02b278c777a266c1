"""The README, the pages of the benchmarks and the guides show the published numbers, and nothing else."""

import re
import sys
from pathlib import Path

import pandas as pd
import pytest
from scipy.stats import chi2

ROOT = Path(__file__).resolve().parents[2]
sys.path.append(str(ROOT / "benchmarks"))

from blocks import with_table, with_tables  # noqa: E402
from readme import BENCHMARKS, BLOCKS, README, WORLDS  # noqa: E402

TABLES = ROOT / "figures" / "spmd" / "tables"
GUIDES = ("docs", "fewruns")  # folders
GUIDE = ROOT / "fewruns" / "README.md"
SAMPLERS = BLOCKS["samplers"].source
PAGE, LINES = BENCHMARKS / "README.md", 120
SAMPLERS_PAGE, DETAILS = BLOCKS["samplers"].text, BLOCKS["vehicles"].text
PAGES = [
    *ROOT.glob("*.md"),
    *ROOT.glob("docs/*.md"),
    *ROOT.glob("fewruns/**/*.md"),
    *BENCHMARKS.rglob("*.md"),
]
DEPLOYMENTS = "../../deployments/github-pages"  # on the hosting page of the repository


@pytest.mark.skipif(not TABLES.exists(), reason="the tables of the real events are not in this copy")
@pytest.mark.parametrize(
    "path", sorted({block.text for block in BLOCKS.values()}), ids=lambda path: path.stem
)
def test_readme_shows_the_published_results(path):
    assert with_tables(path, BLOCKS) == path.read_text(encoding="utf-8")


@pytest.mark.parametrize("name", BLOCKS)
def test_a_table_is_put_between_its_marks(name):
    text, block = BLOCKS[name].text.read_text(encoding="utf-8"), BLOCKS[name]
    changed = with_table(text, name, block, "| new |\n")
    assert "| new |\n" in changed
    assert with_table(changed, name, block, "| old |\n") == with_table(text, name, block, "| old |\n")


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


def test_texts_state_what_the_main_problem_takes():
    rows = pd.read_csv(SAMPLERS).set_index(["problem", "method"]).loc["segment_5_15"]
    text = " ".join(PAGE.read_text(encoding="utf-8").split())
    ours, paper, nais = (rows.loc[method] for method in ("surrogate", "piecewise", "nais_25"))
    assert f"takes {ours.calls_mean:,.0f} simulations on average" in text
    assert f"95 % of the seeds take at most {ours.calls_p95:,.0f}" in text
    assert f"the paper's piecewise method takes {paper.calls_mean:,.0f}" in text
    assert f"OpenTURNS NAIS, {nais.calls_mean:,.0f}" in text
    equal = [f"{row.effective_calls:,.0f}" for row in (ours, paper, nais)]
    assert f"at equal error they take {equal[0]}, {equal[1]} and {equal[2]}" in text
    guide = " ".join(GUIDE.read_text(encoding="utf-8").split())
    assert f"takes {ours.calls_mean:,.0f} simulations on average" in guide
    assert f"95 % of the estimates take at most {ours.calls_p95:,.0f}" in guide


def test_texts_state_how_often_a_part_of_an_event_is_claimed():
    rows = pd.read_csv(BLOCKS["hidden"].source)
    claimed = (rows["claimed"].fillna(0) * rows["failed"] * rows["seeds"]).round()
    assert rows["problem"][claimed > 0].tolist() == ["plane_band"]
    assert claimed.sum() == 1
    has_flags = rows["problem"].str.endswith("flags")
    few = rows[(rows["dimension"] <= 2) | (~has_flags & (rows["dimension"] == 3))]
    off = ((few["failed"] - few["no_number"]) * few["seeds"]).round()
    assert (off == claimed[few.index]).all()
    assert (few["no_number"] * few["seeds"]).round().sum() == 2
    some = rows[~has_flags & rows["dimension"].between(4, 6)]
    eight = rows[~has_flags & (rows["dimension"] > 6)]
    random = rows["problem"].str.startswith("drawn").sum()
    of_all = f"{rows['seeds'].sum():,} estimates of {len(rows)} problems"
    page, detail, guide = (
        " ".join(path.read_text(encoding="utf-8").split()) for path in (PAGE, BLOCKS["hidden"].text, GUIDE)
    )
    assert f"Of {of_all} that hide a part of the event, {random} of them drawn at random, one" in page
    assert f"Of {of_all}, one" in detail
    # Upper 95 % limit of the expected number of claims, given their number (Garwood 1936).
    limit = chi2.ppf(0.95, 2 * (claimed.sum() + 1)) / 2
    stated = re.search(r"With 95 % confidence, fewer than one of ([\d,]+) is therefore claimed", detail)
    assert 0.95 < limit * int(stated[1].replace(",", "")) / few["seeds"].sum() <= 1
    assert f"the {few['seeds'].sum():,} estimates of the {len(few)} problems" in detail
    assert all(f" of {some['seeds'].sum()} estimates" in text for text in (page, detail, guide))
    assert f"of {eight['seeds'].sum()} estimates end" in detail


def test_texts_state_what_the_vehicles_of_the_study_take():
    rows = pd.read_csv(BLOCKS["vehicles"].source)
    striped = rows["vehicle"] == "reg157"
    of_five, of_one = rows[~striped], rows[striped]
    assert not of_five["failed"].any()
    assert not of_one["claimed"].any()
    covered = (of_five["coverage80"] * of_five["seeds"]).sum() / of_five["seeds"].sum()
    contain = f"{(of_one['coverage80'] * of_one['seeds']).sum():.0f} of {of_one['seeds'].sum()} intervals"
    made = pd.read_csv(SAMPLERS).query("method == 'surrogate'")["seeds"].sum()
    for path in (PAGE, DETAILS):
        text = " ".join(path.read_text(encoding="utf-8").split())
        assert f"{of_five['seeds'].sum()}" in text
        assert f"{covered:.0%}".replace("%", " %") + " of the" in text
        assert contain in text
    assert all(f"{made:,} estimates" in path.read_text(encoding="utf-8") for path in (PAGE, SAMPLERS_PAGE))


def test_texts_state_what_vehicles_with_chance_take():
    rows = pd.read_csv(BLOCKS["chance"].source).set_index("problem")
    silent = rows[rows.index.str.endswith("undeclared")]
    page, detail = (
        " ".join(path.read_text(encoding="utf-8").split()) for path in (PAGE, BLOCKS["chance"].text)
    )
    assert all(f"{silent['off'].sum()} of {silent['seeds'].sum()} seeds" in text for text in (page, detail))
    assert not rows.drop(silent.index)["off"].any()
    counts = rows[["seeds", "converged", "covered"]]
    little, noisy, shaken = (counts.loc[name] for name in ("noise_0.1", "noise_0.3", "shaken_0.1"))
    assert f"{little.covered} of {little.seeds} intervals cover" in page
    for text in (page, detail):
        assert f"{noisy.covered} of the {noisy.converged} that converge" in text
    assert f"({shaken.covered} of {shaken.converged})" in detail
    assert (rows["seeds"] == 40).all()
    runs = {name: f"{rows.loc[name, 'simulations']:.0f}" for name in ("noise_0.1", "half_space")}
    assert f"{runs['noise_0.1']} runs with noise of 0.1, and {runs['half_space']} without noise" in detail


def test_texts_state_what_the_runs_of_a_similar_vehicle_save():
    rows = pd.read_csv(BLOCKS["successors"].source)
    page, detail = (
        " ".join(path.read_text(encoding="utf-8").split()) for path in (PAGE, BLOCKS["successors"].text)
    )
    known, alone = f"{rows['simulations'].mean():.0f}", f"{rows['simulations_alone'].mean():.0f}"
    variants = rows[rows["variant"] != "the same car"]
    ranked = f"{(variants['ranked'] * variants['seeds']).sum():.0f} of {variants['seeds'].sum()} pairs"
    assert f"{known} runs instead of {alone}" in page
    assert f"takes {known} simulations instead of {alone}" in detail
    assert all(ranked in text for text in (page, detail))
    assert not rows["off"].any()


@pytest.mark.parametrize(
    "path", sorted({block.text for block in BLOCKS.values()}), ids=lambda path: path.stem
)
def test_every_row_of_a_table_has_as_many_cells_as_its_head(path):
    cells = 0
    for line in path.read_text(encoding="utf-8").splitlines():
        row = line.replace("\\|", "").count("|") if line.startswith("|") else 0
        assert not cells or row in (0, cells), line
        cells = row


@pytest.mark.parametrize("problem", ["segment_15_25", "impact_10"])
def test_the_known_limits_name_the_most_expensive_problems(problem):
    row = pd.read_csv(SAMPLERS).set_index(["problem", "method"]).loc[(problem, "surrogate")]
    assert f"about {5 * round(row.calls_mean / 5)}" in " ".join(PAGE.read_text(encoding="utf-8").split())


@pytest.mark.skipif(not TABLES.exists(), reason="the tables of the real events are not in this copy")
def test_the_benchmarks_state_how_far_thresholds_move_the_answer():
    probability = pd.read_csv(TABLES / "answer_thresholds.csv")["probability"]
    moved = probability.max() / probability.min()
    text = " ".join(WORLDS.read_text(encoding="utf-8").split())
    assert f"the answer moves by {moved:.2f} over the thresholds" in text


@pytest.mark.skipif(not TABLES.exists(), reason="the tables of the real events are not in this copy")
def test_the_benchmarks_are_of_the_present_laws_or_say_that_they_are_older():
    laws = pd.read_csv(TABLES / "laws.csv").iloc[1:].set_index("law")
    heaviest = laws["weight"].idxmax()
    exact = pd.read_csv(BLOCKS["vehicles"].source).query("vehicle == 'acc_aeb'").set_index("law")["exact"]
    exported = pd.read_csv(BLOCKS["exported"].source).set_index("vehicle")["exact"]
    answer = pd.read_csv(TABLES / "answer.csv").set_index("event").loc["crash"]
    runs = pd.read_csv(BLOCKS["answers"].source.with_stem("answers_runs")).set_index("vehicle")
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
        text = " ".join(BLOCKS[name].text.read_text(encoding="utf-8").split())
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
