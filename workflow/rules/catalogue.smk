# Catalogue: inputs and outputs of each notebook, which its metadata declare, and their entries in the report.
#
# In: the notebooks, the captions. Out: nothing; definitions only.

from accelerated_evaluation.base.extensions import added
from accelerated_evaluation.publishing.article.text import shown_figures
from accelerated_evaluation.publishing.book.catalogue import (
    read_contents,
    require_captions,
)

FIGURE_FORMATS = ["png", "pdf", "svg", "csv"]
TABLE_FORMATS = ["csv", "md", "tex"]
CAPTIONS = PROJECT / "workflow/report"
TITLES = str(PROJECT / "workflow/titles.yaml")  # findings of figures
ARTICLE = PROJECT / "article"
# Results that the rules above make, by their paths in the folder of the results. A workflow that uses this one as a
# module may have put a prefix before this folder.
PREFIX = str(rules.ingest_encounters.output.encounters).removesuffix(
    result("encounters.parquet")
)
MADE = sorted(
    {
        file.removeprefix(f"{PREFIX}{RESULTS}/")
        for each in workflow.rules
        for file in map(str, each.output)
        if file.startswith(f"{PREFIX}{RESULTS}/") and "{" not in file
    }
    | {"config.json", "contents.json"}
)


def files_of_result(name):
    """Paths of a result; a name with {method} represents those of all methods with a search."""
    path = result(name)
    return list(dict.fromkeys(path.replace("{method}", each) for each in SEARCHING))


def is_made(name):
    """Whether this study makes a result."""
    return name in MADE or any(
        each.is_producer(PREFIX + path)
        for path in files_of_result(name)
        for each in workflow.rules
    )


PATHS = {path.stem: path for path in sorted((PROJECT / "notebooks").glob("*.ipynb"))}
# The guides of the study, and those of the sampler, which is a package of its own.
FOLDERS_OF_GUIDES = [PROJECT / "docs", PROJECT / "fewruns"]
GUIDES = [
    str(path) for folder in FOLDERS_OF_GUIDES for path in sorted(folder.glob("*.md"))
]
PICTURES = [
    str(path) for folder in FOLDERS_OF_GUIDES for path in sorted(folder.glob("*.svg"))
]
ON_FIRST_PAGE = ["records_report.csv", "laws/answer.csv", "laws/extrapolation.csv"]
ON_FIRST_PAGE += [
    name
    for name in ("exact.csv", "crude.csv", "laws/impact_speeds.csv")
    if is_made(name)
]
try:
    NOTEBOOKS = {
        name: contents
        for name, path in PATHS.items()
        if (contents := read_contents(path, is_made)) is not None
    }
    require_captions(
        [name for made in NOTEBOOKS.values() for name in [*made.figures, *made.tables]],
        CAPTIONS,
    )
    # Figures that modules of the user register, which no notebook shows. The module that knows their results is
    # imported only then, because it takes a second.
    if OWN_FIGURES := added("accelerated_evaluation.publishing.figures"):
        from accelerated_evaluation.publishing.published import results_of

        READ_BY_OWN = {name: results_of(name) for name in OWN_FIGURES}
except StudyError as error:
    raise WorkflowError(str(error)) from None


def notebook_of(name):
    """Path of a notebook."""
    return local(str(PATHS[name]))


def read_by(notebook):
    """Results that a notebook reads."""
    return [
        path for name in NOTEBOOKS[notebook].reads for path in files_of_result(name)
    ]


def in_report(path, category, name, caption):
    """Mark a file for the Snakemake report, with its category, name and caption."""
    return report(
        path,
        caption=str((CAPTIONS / f"{caption}.rst").resolve()),
        category=category,
        labels={"name": name},
    )


def files_of(name, folder, formats, category):
    """Files of a figure or a table in all formats; that of the first format is marked for the report."""
    first, *others = [str(folder / f"{name}.{extension}") for extension in formats]
    return [in_report(first, category, name, caption=name), *others]


def figures_of(notebook):
    """Files of the figures that a notebook makes."""
    names = NOTEBOOKS[notebook].figures
    return [
        file
        for name in names
        for file in files_of(name, FIGURES, FIGURE_FORMATS, "Figures")
    ]


def tables_of(notebook):
    """Files of the tables that a notebook makes."""
    names = NOTEBOOKS[notebook].tables
    return [
        file
        for name in names
        for file in files_of(name, FIGURES / "tables", TABLE_FORMATS, "Tables")
    ]


def captions_of(notebook):
    """Files of the captions of the figures and tables that a notebook shows, and of the titles of figures."""
    names = [*NOTEBOOKS[notebook].figures, *NOTEBOOKS[notebook].tables]
    return local([*(str(CAPTIONS / f"{name}.rst") for name in names), TITLES])


def rendered_of(notebook):
    """File of an executed notebook for reading."""
    return str(FIGURES / "notebooks" / f"{notebook}.ipynb")


def shown_in_article(_):
    """Figures that the article shows; an error if the study does not publish all of them."""
    published = {name for made in NOTEBOOKS.values() for name in made.figures}
    for name in shown_figures(ARTICLE):
        if name not in published:
            raise WorkflowError(
                f"the study {STUDY} has no article, because it does not publish {name}, which the article shows. An"
                " article can be made for a study of cut-ins whose vehicle is fast enough for a crash map"
                " (simulations.slow: false). Make the book instead: make book."
            )
    return [str(FIGURES / f"{name}.pdf") for name in shown_figures(ARTICLE)]


def files_of_own(figure):
    """Files of a figure that a module of the user registers."""
    return [str(FIGURES / f"{figure}.{extension}") for extension in FIGURE_FORMATS]
