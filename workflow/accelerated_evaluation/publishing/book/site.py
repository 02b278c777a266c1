"""The book: the executed notebooks and the guides as a web site made by Sphinx, which works offline.

First, the sources are written to a temporary folder. Every notebook is a chapter: each of its figures gets a
number, a caption, an alternative text and links to its files, and its tables are listed at its end. Every
guide is a chapter too. The first and the last page are templates in ``workflow/book`` with placeholders, as
in the texts of the notebooks (`publishing.texts`). Sphinx then makes the site. The site contains no
date, so the same study always gives the same bytes.
"""

import inspect
import platform
import re
import shutil
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from importlib.metadata import version
from importlib.resources import files
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import nbformat
import yaml
from nbformat import NotebookNode
from PIL import Image
from sphinx.application import Sphinx
from sphinx.util.console import nocolor

from accelerated_evaluation.base.errors import StudyError
from accelerated_evaluation.base.files import PROJECT, file_digest
from accelerated_evaluation.publishing.book.catalogue import read_contents
from accelerated_evaluation.publishing.figures.moving import is_moving
from accelerated_evaluation.publishing.provenance import commit_of, page_of_code
from accelerated_evaluation.publishing.published import FIGURES, alternative, caption_of, heading
from accelerated_evaluation.publishing.study import TABLES, Study
from accelerated_evaluation.publishing.tables.claims import departure
from accelerated_evaluation.publishing.tables.display import NAMES
from accelerated_evaluation.publishing.tables.evidence import rests_in_words
from accelerated_evaluation.publishing.tables.exact import contradictions
from accelerated_evaluation.publishing.tables.paper_claims import PAPER_PROBABILITY
from accelerated_evaluation.publishing.texts import fill

# Packages whose versions the last page lists: those behind numbers, figures and pages. environment.txt pins
# all.
PACKAGES: tuple[str, ...] = ("numpy", "scipy", "pandas", "pyarrow", "numba", "matplotlib")
PACKAGES += ("snakemake", "papermill", "jinja2", "sphinx", "myst-nb", "sphinx-book-theme")

# Guides in the order in which a reader needs them; the last group takes those that are not listed.
GUIDES = {
    "Your records and your vehicle": (
        "your_records",
        "records_report",
        "formats_of_recordings",
        "records_from_europe",
        "your_vehicle",
        "your_simulator",
        "staying_program",
        "vehicle_reference",
        "the_explorer",
    ),
    "Proving ground and safety case": ("campaign", "export", "safety_case"),
    "Methods": (
        "fewruns",
        "sampler_reference",
        "method",
        "law_of_cut_ins",
        "joint_laws",
        "human_driver",
        "left_turn_and_pedestrian",
    ),
    "Extend and publish": (
        "your_scenario",
        "extensions",
        "interface",
        "cluster",
        "book",
        "article",
        "provenance",
        "glossary",
    ),
}
FIGURE_FILES = {"PDF": "pdf", "SVG": "svg", "PNG": "png", "data": "csv"}
TABLE_FILES = {"CSV": "csv", "Markdown": "md", "LaTeX": "tex"}
PARAMETERS = {
    "parameters",
    "injected-parameters",
}  # tags of cells that set paths, not in the book
MATHJAX = "tex-svg.js"  # one file that draws formulas and adds MathML for screen readers; it needs no fonts
STYLE, SCRIPT = "book.css", "book.js"
CHAPTER_LINK = re.compile(r"(?<!!)\[(?P<text>[^\]]+)\]\((?P<chapter>\w+\.ipynb)(#[^)]*)?\)")
TABLE_LINK = re.compile(r"\.\./tables/\w+\.csv")  # of an executed notebook
PIXELS = 2  # pixels of a PNG file per pixel of its width on the page, so that enlarged figures are sharp
ADDED = """# Figures of your own

These figures are drawn by functions that your modules register (configuration key `modules`,
[guide](extensions.md)). The caption of each figure is the docstring of its function."""


def known_to_pages(study: Study, records: Iterable[str]) -> dict[str, Any]:
    """Return the values that are inserted into the templates of the first and the last page, by name.

    The last page lists the SHA-256 checksums of the records.
    """
    answer = study.answer
    return {
        "vehicle": (vehicle := study.config["vehicle"]),
        "tested": NAMES.get(vehicle["name"], vehicle["name"]),
        "crash": answer[answer["event"] == "crash"].iloc[0],
        "rests": rests_in_words(study.extrapolation),
        "paper": _of_the_paper(study) if study.has("exact", "crude") else None,
        "commit": commit_of(PROJECT),
        "checksums": {str(path): _checksum(Path(path)) for path in records},
        "versions": {"Python": platform.python_version()} | {name: version(name) for name in PACKAGES},
        "configuration": yaml.safe_dump(study.config, allow_unicode=True, sort_keys=False).strip(),
    }


def _of_the_paper(study: Study) -> dict[str, Any]:
    """Return the values that need results of the paper's methods and of crude Monte Carlo."""
    return {
        "probability": PAPER_PROBABILITY,
        "departed": departure(study.premises, study.source),
        "contradicted": contradictions(study.truth, study.crude),
    }


def _checksum(path: Path) -> str:
    """Return the SHA-256 of a data file, or "no such file", since it may have been deleted meanwhile."""
    return file_digest(path) if path.is_file() else "no such file"


@dataclass(frozen=True)
class Parts:
    """The parts from which a book is made."""

    study: Study
    notebooks: Sequence[Path]  # executed notebooks, one for each chapter, in order
    tables: Mapping[str, Sequence[str]]  # names of the tables that each notebook makes
    guides: Sequence[Path]  # markdown files, one for each chapter, in order
    pages: Path  # folder with the templates of the first and the last page, the style and a script
    # The page ``explorer.html``, which is copied into the site; None if the study has none.
    explorer: Path | None = None
    added: Sequence[str] = ()  # names of the figures that modules of the user register

    def without_missing(self, text: str) -> str:
        """Return Markdown in which links to chapters that the book does not have are plain text."""
        chapters = {path.name for path in self.notebooks}

        def link(match: re.Match) -> str:
            return match[0] if match["chapter"] in chapters else match["text"]

        return CHAPTER_LINK.sub(link, text)

    def figure(self, name: str, label: str | None = None) -> str:
        """Return a figure as MyST Markdown: image, number, title, caption, alternative text and links.

        The label is the target of links to the figure, its name by default. If the figure is shown on a
        second page, it needs another label there. The title is that in the metadata of the PNG file.
        """
        first, *rest = caption = caption_of(self.study, name, FIGURES[name])
        with Image.open(self.study.figures / f"{name}.png") as image:
            width, title = image.width // PIXELS, image.info.get("Title", name)
        title = "" if title == name else title
        picture = f"{name}.svg" if is_moving(self.study.figures / f"{name}.svg") else f"{name}.png"
        # A click on the picture opens it alone, where a browser can enlarge it.
        return (
            f"````{{figure}} figures/{picture}\n:name: {label or name}\n:alt: {alternative(title, caption)}\n"
            f":width: {width}px\n"
            f":target: _images/{picture}\n\n{heading(name, title)} {' '.join(first.split())}\n\n"
            f"{' '.join(' '.join(rest).split())}\n\n{_links('figures', name, FIGURE_FILES)}\n\n"
            f"{self.origin(name)}\n````\n"
        )

    def origin(self, name: str) -> str:
        """Return the function, the rule and the results that make a figure, with a link to the code."""
        make = inspect.unwrap(FIGURES[name])
        file, line = Path(inspect.getsourcefile(make)), inspect.getsourcelines(make)[1]
        is_own = name in self.added
        place = file.name if is_own else file.resolve().relative_to(PROJECT.resolve()).as_posix()
        code = f"`{name}` ({place}, line {line})"
        if not is_own and (page := page_of_code(PROJECT, file, line)):
            code = f"[{code}]({page})"
        parts = [part for part in inspect.signature(make).parameters if part in TABLES]
        read = [f"`{TABLES[part]}`" for part in parts if self.study.has(part)]
        rule = next((path.stem for path in self.notebooks if name in read_contents(path).figures), None)
        made = [f"Code: {code}"]
        made += [f"results: {', '.join(read)}"] if read else []
        rule = f"draw_{name}" if is_own else rule and f"run_{rule}"
        made += [f"rule: `{rule}`"] if rule else []
        alone = f"`snakemake --cores 2 {(self.study.figures / name).as_posix()}.png`"
        return "; ".join(made) + f". Made alone by {alone}."

    def table(self, name: str) -> str:
        """Return links to the files of a published table, as an item of a Markdown list."""
        return f"- **{name}**: {_links('figures/tables', name, TABLE_FILES)}"


def build_book(parts: Parts, site: Path, names: dict[str, Any]) -> None:
    """Write the site of a study, and replace the previous one.

    The folder appears when it is complete, with ``index.html`` as its first page; ``names`` are further names
    for the templates. StudyError is raised if a placeholder cannot be filled in, or Sphinx fails.
    """
    site.parent.mkdir(parents=True, exist_ok=True)
    with TemporaryDirectory(prefix=f".{site.name}.", dir=site.parent) as temporary:
        sources, made = Path(temporary, "sources"), Path(temporary, "site")
        _write_sources(parts, sources, names)
        _run_sphinx(sources, made, Path(temporary, "doctrees"), parts.study.name)
        if parts.explorer is not None:
            shutil.copy(parts.explorer, made / "explorer.html")
        shutil.rmtree(site, ignore_errors=True)
        made.rename(site)


def _write_sources(parts: Parts, sources: Path, names: dict[str, Any]) -> None:
    shutil.copytree(parts.study.figures, sources / "figures")
    shutil.copytree(parts.pages, sources, dirs_exist_ok=True)
    shutil.copy(files("sphinx-mathjax-offline") / "static" / "mathjax" / MATHJAX, sources)
    for guide in parts.guides:
        text = in_one_folder(guide.read_text(encoding="utf-8"))
        (sources / f"{page_of(guide)}.md").write_text(parts.without_missing(text), encoding="utf-8")
        for picture in guide.parent.glob(f"{guide.stem}_*.svg"):
            shutil.copy(picture, sources)
    chapters: dict[str, Any] = {}  # by their part of the book
    for path in parts.notebooks:
        text = TABLE_LINK.sub("#tables-of-this-chapter", path.read_text(encoding="utf-8"))
        notebook = nbformat.reads(text, as_version=4)
        chapters.setdefault(notebook.metadata.get("part", "Chapters"), []).append(path.stem)
        notebook.cells = list(_chapter(parts, path.stem, notebook))
        nbformat.write(notebook, sources / path.name)
    known = names | {"study": parts.study, "figure": parts.figure, "explorer": parts.explorer}
    if parts.added:
        figures = "\n".join(map(parts.figure, parts.added))
        (sources / "added_figures.md").write_text(f"{ADDED}\n\n{figures}", encoding="utf-8")
    known |= {"added": parts.added, "notebooks": chapters, "guides": grouped(map(page_of, parts.guides))}
    for template in parts.pages.glob("*.md"):
        page = sources / template.name
        page.write_text(fill(page.read_text(encoding="utf-8"), known), encoding="utf-8")


def page_of(guide: Path) -> str:
    """Return the name of the page of a guide in the book: that of its file, or of the folder of a README."""
    return guide.parent.name if guide.stem == "README" else guide.stem


def grouped(pages: Iterable[str]) -> dict[str, list[str]]:
    """Return the pages of guides by the caption of their group, in the order of `GUIDES`."""
    left = set(pages)
    groups = {}
    for group, names in GUIDES.items():
        groups[group] = [name for name in names if name in left]
        left -= set(names)
    groups[group] += sorted(left)
    return {group: names for group, names in groups.items() if names}


def in_one_folder(text: str) -> str:
    """Return Markdown in which guides and notebooks are linked as if they were in one folder."""
    return re.sub(r"\]\((\.\./)+(docs|fewruns|notebooks)/", "](", text).replace("](README.md", "](fewruns.md")


def _chapter(parts: Parts, name: str, notebook: NotebookNode) -> Iterator[NotebookNode]:
    """Yield the cells of a chapter: code hidden behind a button, figures with captions, list of tables."""
    silent = ""  # code without outputs is joined with the next cell of code, under one button
    for cell in notebook.cells:
        if cell.cell_type == "code" and not PARAMETERS & set(cell.metadata.get("tags", [])):
            figures = [shown for output in cell.outputs if (shown := _published(output))]
            cell.outputs = [
                output
                for output in cell.outputs
                if not (_published(output) or "of" in output.get("metadata", {}))
            ]
            cell.source, silent = silent + cell.source, ""
            cell.metadata["tags"] = ["hide-input"]
            if cell.outputs or figures:
                yield cell
            else:
                silent = f"{cell.source}\n\n"
            yield from (nbformat.v4.new_markdown_cell(parts.figure(shown), id=shown) for shown in figures)
        elif cell.cell_type != "code" and cell.source:
            if silent and cell.source.startswith("<details"):  # the last text, about the study
                metadata = {"tags": ["hide-input"]}
                yield nbformat.v4.new_code_cell(silent.strip(), id="code", metadata=metadata)
            cell.source = parts.without_missing(in_one_folder(cell.source))
            yield cell
    if tables := parts.tables[name]:
        listed = "\n".join(map(parts.table, tables))
        yield nbformat.v4.new_markdown_cell(f"## Tables of this chapter\n\n{listed}", id="tables")


def _published(output: NotebookNode) -> str | None:
    """Return the name of the published figure that an output shows; None for other outputs."""
    return output.get("metadata", {}).get("image/png", {}).get("published")


def _links(folder: str, name: str, endings: dict[str, str]) -> str:
    return " · ".join(f"[{shown}](path:{folder}/{name}.{ending})" for shown, ending in endings.items())


def _run_sphinx(sources: Path, made: Path, doctrees: Path, study: str) -> None:
    settings = {
        "project": f"Cut-ins: {study}",
        "html_title": f"How often does it crash? Study {study}",
        "extensions": ["myst_nb"],
        "exclude_patterns": ["figures/**"],
        "html_theme": "sphinx_book_theme",
        "html_theme_options": {
            "use_download_button": False,
            "use_fullscreen_button": False,
            "navbar_start": [],
            "navbar_persistent": [],
            "navbar_end": [],
            "footer_content_items": [],  # which would name an author that is not set
            "show_toc_level": 2,
            "search_bar_text": "Search the book",
        },
        "templates_path": ["."],
        "html_static_path": [MATHJAX, STYLE, SCRIPT],
        "html_css_files": [STYLE],
        "html_js_files": [SCRIPT],
        "html_copy_source": False,
        "html_use_index": False,
        "html_show_copyright": False,
        "html_show_sphinx": False,
        "html_context": {"default_mode": "auto"},
        "html_permalinks_icon": "#",
        "mathjax_path": MATHJAX,
        "myst_enable_extensions": ["dollarmath", "amsmath"],
        "myst_heading_anchors": 3,
        "nb_execution_mode": "off",
        "nb_render_markdown_format": "myst",
        "nb_code_prompt_show": "Show the code",
        "nb_code_prompt_hide": "Hide the code",
    }
    nocolor()  # warnings of Sphinx go to a log file, without codes for colours
    try:
        app = Sphinx(sources, None, made, doctrees, "html", settings, status=None, freshenv=True)
        app.build(force_all=True)
    except Exception as error:
        raise StudyError(f"Sphinx cannot make the book: {type(error).__name__}: {error}") from error
    (made / ".buildinfo").unlink(missing_ok=True)
