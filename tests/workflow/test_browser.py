"""The book and the Snakemake report of a finished study, opened in a real browser that has no network.

The browser is the Chromium of the machine, driven by Playwright. Every page is opened from the disk.
"""

import re
from pathlib import Path
from urllib.parse import unquote, urlsplit

import pytest

pytestmark = pytest.mark.browser
SCREENS = {"wide": (1400, 900), "narrow": (390, 800)}
BROKEN = "() => [...document.images].filter(i => !i.complete || !i.naturalWidth).map(i => i.src)"
SILENT = "() => [...document.images].filter(i => !i.alt.trim()).map(i => i.src)"
FORMULAS = "() => ['.math', '.math:has(mjx-container svg)'].map(s => document.querySelectorAll(s).length)"
WRONG = "() => document.querySelectorAll('mjx-merror, [data-mml-node=merror]').length"
ANCHORS = "() => [...document.querySelectorAll('a[href]')].map(a => a.href)"
NAMES = "() => [...document.querySelectorAll('[id]')].map(e => e.id)"
PROSE = "() => { document.querySelectorAll('pre').forEach(e => e.remove()); return document.body.innerText; }"
TOO_WIDE = "() => document.documentElement.scrollWidth - document.documentElement.clientWidth"


class Watch:
    """A page, and everything that goes wrong in it."""

    def __init__(self, page):
        self.page, self.faults = page, []
        page.on("console", lambda said: said.type == "error" and self.faults.append(f"console: {said.text}"))
        page.on("pageerror", lambda error: self.faults.append(f"script: {error}"))
        page.on("requestfailed", lambda request: self.faults.append(f"failed: {request.url[:200]}"))
        page.on("request", self._require_local)

    def _require_local(self, request):
        if urlsplit(request.url).scheme not in ("file", "data", "blob", "about"):
            self.faults.append(f"leaves the machine: {request.url[:200]}")

    def open(self, path, wait="load"):
        self.page.goto(Path(path).as_uri() if isinstance(path, Path) else path, wait_until=wait)
        return self.page


@pytest.fixture
def watch(browser, request):
    width, height = SCREENS[getattr(request, "param", "wide")]
    context = browser.new_context(viewport={"width": width, "height": height}, offline=True)
    context.set_default_timeout(60_000)
    yield Watch(context.new_page())
    context.close()


@pytest.fixture(scope="module")
def site(finished):
    return finished.folder / "results" / "smoke" / "book"


@pytest.mark.parametrize("watch", SCREENS, indirect=True)
def test_every_page_of_the_book_is_whole(watch, site):
    pages = sorted(site.glob("*.html"))
    assert len(pages) > 12
    formulas = 0
    for path in pages:
        page = watch.open(path)
        if page.evaluate(FORMULAS)[0]:
            page.wait_for_function("() => window.MathJax && MathJax.startup && MathJax.startup.promise")
            page.evaluate("() => MathJax.startup.promise")
            wanted, drawn = page.evaluate(FORMULAS)
            assert drawn == wanted, path.name
            formulas += drawn
        assert not page.evaluate(WRONG), path.name
        assert not page.evaluate(BROKEN), path.name
        assert not page.evaluate(SILENT), path.name
        assert page.evaluate(TOO_WIDE) <= 0, path.name
        assert not re.search(r"\bnan\b|\{\{|\}\}|&#\d|name not set", page.evaluate(PROSE)), path.name
    assert formulas > 100
    assert not watch.faults, watch.faults[:10]


def test_every_link_of_the_book_holds(watch, site):
    links, names = {}, {}
    for path in sorted(site.glob("*.html")):
        page = watch.open(path)
        names[path.name] = set(page.evaluate(NAMES))
        links[path.name] = set(page.evaluate(ANCHORS))
    for origin, targets in links.items():
        for target in targets:
            parts = urlsplit(target)
            if parts.scheme != "file":
                assert parts.scheme in ("https", "javascript"), (origin, target)
                continue
            path = Path(unquote(parts.path))
            assert path.is_relative_to(site), (origin, target)
            assert path.is_file(), (origin, target)
            if path.suffix == ".html" and parts.fragment:
                assert unquote(parts.fragment) in names[path.name] | {""}, (origin, target)
    kinds = {Path(urlsplit(target).path).suffix for targets in links.values() for target in targets}
    assert {".html", ".pdf", ".svg", ".png", ".csv", ".md", ".tex"} <= kinds


def test_the_first_page_tells_the_answer(watch, site):
    article = watch.open(site / "index.html").inner_text("article")
    for words in ("Study smoke", "acc_aeb", "80 %", "Figure 23.", "verdict"):
        assert words in article
    last = watch.open(site / "made.html").inner_text("article")
    for words in ("study: smoke", "SHA-256", "commit", "numpy", "sample: 6000"):
        assert words in last


def test_search_finds_a_word(watch, site):
    page = watch.open(site / "search.html")
    page.goto((site / "search.html").as_uri() + "?q=Songchitruksa")
    page.wait_for_selector("#search-results li a")
    assert "02_the_answer.html" in page.get_attribute("#search-results li a", "href")
    assert not watch.faults


def test_the_report_on_the_records_needs_no_scrolling_on_a_wide_screen(browser, site):
    page = browser.new_page(viewport={"width": 1600, "height": 900})
    page.goto((site / "91_the_records.html").as_uri())
    sizes = page.eval_on_selector_all(
        ".cell_output .output", "all => all.map(e => e.scrollWidth - e.clientWidth)"
    )
    assert sizes
    assert max(sizes) <= 1
    page.close()


def test_code_is_folded_away_and_opens_by_the_keyboard(watch, site):
    page = watch.open(site / "02_the_answer.html")
    folded = page.locator("details.hide")
    assert folded.count() >= 2
    assert not page.locator("details.hide div.input_area, details.hide .highlight").first.is_visible()
    folded.first.locator("summary").focus()
    page.keyboard.press("Enter")
    page.wait_for_selector("details.hide[open]")
    assert page.locator("details.hide[open] .highlight").first.is_visible()


def test_a_figure_opens_alone_from_the_keyboard(watch, site):
    page = watch.open(site / "09_ground_truth.html")
    page.locator("figure a:has(img)").first.focus()
    page.keyboard.press("Enter")
    page.wait_for_url(re.compile(r"_images/fig15_\w+\.png$"))


def test_the_report_asks_for_nothing_from_the_network(watch, finished, tmp_path):
    run = finished.run("--report", str(tmp_path / "report.html"))
    assert run.returncode == 0, run.stderr[-3000:]
    page = watch.open(tmp_path / "report.html")
    page.wait_for_selector("text=Figures")
    assert not page.evaluate(BROKEN)
    assert not watch.faults, watch.faults[:10]
