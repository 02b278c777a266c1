"""The book can be put on a web server as it is: it is complete, and its links stay in its folder."""

from collections.abc import Iterator
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote, urlsplit

import yaml

ROOT = Path(__file__).resolve().parents[2]


class Links(HTMLParser):
    """The addresses that a page names."""

    def __init__(self, page: Path) -> None:
        super().__init__()
        self.found: list[str] = []
        self.feed(page.read_text(encoding="utf-8"))

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.found += [value for name, value in attrs if name in ("href", "src") and value]


def faults(site: Path) -> Iterator[tuple[str, str]]:
    """Yield each page with an address that is absolute or leads to no file of the site."""
    for page in site.resolve().glob("*.html"):
        for link in Links(page).found:
            address = urlsplit(link)
            if address.scheme in ("http", "https", "data", "javascript", "mailto"):
                continue
            target = (page.parent / unquote(address.path)).resolve() if address.path else page
            if link.startswith("/") or not target.is_relative_to(site.resolve()) or not target.is_file():
                yield page.name, link


def test_every_link_of_the_book_leads_to_one_of_its_files(finished):
    site = finished.folder / "results/smoke/book"
    assert {"index.html", "explorer.html", "02_the_answer.html"} <= {path.name for path in site.iterdir()}
    assert sum(len(Links(page).found) for page in site.glob("*.html")) > 1000
    assert list(faults(site)) == []


def test_absolute_and_broken_links_are_found(tmp_path):
    (tmp_path / "a.html").write_text(
        '<a href="a.html#x">.</a><a href="/a.html">.</a><img src="b.png"><a href="../c">.</a><a href="https://d">.</a>'
    )
    assert [link for _, link in faults(tmp_path)] == ["/a.html", "b.png", "../c"]


def test_the_page_of_the_repository_is_the_book_of_the_default_study():
    workflow = yaml.safe_load((ROOT / ".github/workflows/pages.yml").read_text())
    (job,) = workflow["jobs"].values()
    commands = [step["run"].split(" #")[0].strip() for step in job["steps"] if "run" in step]
    assert commands[0] == "make study PYTHON=python"
    uploaded = next(step["with"]["path"] for step in job["steps"] if "upload-pages" in step.get("uses", ""))
    study = yaml.safe_load((ROOT / "config/config.yaml").read_text())["study"]
    assert uploaded == f"results/{study}/book"
    assert {"pages": "write", "id-token": "write"}.items() <= workflow["permissions"].items()
