# Catalogue: inputs and outputs of each notebook, which its metadata declare, and their entries in the report.
#
# In: the notebooks, the captions. Out: nothing; definitions only.

from accelerated_evaluation.base.extensions import added
from accelerated_evaluation.publishing.article.tables import shown_figures
from accelerated_evaluation.publishing.book.catalogue import (
    read_contents,
    require_captions,
)

FIGURE_FORMATS = ["png", "pdf", "svg", "csv"]
TABLE_FORMATS = ["csv", "md", "tex"]
CAPTIONS = PROJECT / "workflow/report"
ARTICLE = PROJECT / "article"
FOLDER = PROJECT / "notebooks" if "maps" in STAGES else PROJECT / "notebooks/scenario"
CHAPTERS = sorted(FOLDER.glob("*.ipynb"))
# A study of a slow vehicle has its own chapters, and those chapters of other studies whose results it has.
if SLOW:
    SHARED = ("05", "06", "12", "91") if "maps" in STAGES else ("01", "02")
    CHAPTERS = [path for path in CHAPTERS if path.stem.startswith(SHARED)]
    CHAPTERS = sorted(
        [*CHAPTERS, *(FOLDER / "slow").glob("*.ipynb")], key=lambda path: path.stem
    )
PATHS = {path.stem: path for path in CHAPTERS}
# The guides of the study, and those of the sampler, which is a package of its own.
FOLDERS_OF_GUIDES = [PROJECT / "docs", PROJECT / "fewruns"]
GUIDES = [
    str(path) for folder in FOLDERS_OF_GUIDES for path in sorted(folder.glob("*.md"))
]
PICTURES = [
    str(path) for folder in FOLDERS_OF_GUIDES for path in sorted(folder.glob("*.svg"))
]
ON_FIRST_PAGE = ["records_report.csv", "laws/answer.csv"]
if "maps" in STAGES:
    ON_FIRST_PAGE += ["laws/compared.csv"] if SLOW else ["exact.csv", "crude.csv"]
try:
    NOTEBOOKS = {name: read_contents(path) for name, path in PATHS.items()}
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
    """Results that a notebook reads; a name with {method} is replaced by those of all methods with a search."""
    paths = [result(name) for name in NOTEBOOKS[notebook].reads]
    return [
        file
        for path in paths
        for file in (expand(path, method=SEARCHING) if "{method}" in path else [path])
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
