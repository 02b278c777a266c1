"""The guides: their order in the book, and a table of contents on each long page."""

import re
from pathlib import Path

import pytest
from accelerated_evaluation.publishing.book.site import GUIDES, grouped, page_of

ROOT = Path(__file__).resolve().parents[3]
LONG = 1_200  # words; a longer page has a table of contents
IN_THE_BOOK = sorted([*ROOT.glob("docs/*.md"), *ROOT.glob("fewruns/*.md")])
PAGES = [*IN_THE_BOOK, *ROOT.glob("config/*.md"), *ROOT.glob("benchmarks/samplers/*.md")]


def test_the_order_of_the_book_names_each_guide_once():
    listed = [name for names in GUIDES.values() for name in names]
    assert sorted(listed) == sorted(map(page_of, IN_THE_BOOK))


def test_guides_are_grouped_in_order_and_new_ones_come_last():
    groups = grouped(["method", "a_new_page", "your_records", "fewruns"])
    assert list(groups.values()) == [["your_records"], ["fewruns", "method"], ["a_new_page"]]


@pytest.mark.parametrize("path", PAGES, ids=lambda path: str(path.relative_to(ROOT)))
def test_a_long_page_lists_its_sections(path):
    text = re.sub(r"```.*?```", "", path.read_text(encoding="utf-8"), flags=re.DOTALL)
    headings = re.findall(r"^## (.+)$", text, re.MULTILINE)
    anchors = [re.sub(r"[^\w\- ]", "", heading.lower()).replace(" ", "-") for heading in headings]
    contents = text.split("\n## ")[0]
    if len(text.split()) > LONG:
        assert [anchor for anchor in anchors if f"(#{anchor})" not in contents] == []
