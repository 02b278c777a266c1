# Publish: one notebook a section of the paper, each making its figures and tables from finished results.
#
# In: everything under results/<study>/. Out: figures/<study>/*.{pdf,svg,png,csv}, figures/<study>/tables/*, the
# executed notebooks and their HTML. What each notebook reads and makes is found out from its code.

from accelerated_evaluation.publishing.catalogue import (
    read_contents,
    require_captions,
)

FIGURE_FORMATS = ["png", "pdf", "svg", "csv"]
TABLE_FORMATS = ["csv", "md", "tex"]
CAPTIONS = Path("workflow/report")
try:
    NOTEBOOKS = {
        path.stem: read_contents(path)
        for path in sorted(Path("notebooks").glob("*.ipynb"))
    }
    require_captions(
        [name for made in NOTEBOOKS.values() for name in [*made.figures, *made.tables]],
        CAPTIONS,
    )
except StudyError as error:
    raise WorkflowError(str(error)) from None


def read_by(notebook):
    """Results that a notebook reads; a name with {method} stands for those of all methods."""
    paths = [result(name) for name in NOTEBOOKS[notebook].reads]
    return [
        file
        for path in paths
        for file in (expand(path, method=SEARCHING) if "{method}" in path else [path])
    ]


def in_report(path, category, name, caption):
    """Show a file in the report, under its category and with a caption."""
    return report(
        path,
        caption=f"{workflow.basedir}/{CAPTIONS}/{caption}.rst",
        category=category,
        labels={"name": name},
    )


def files_of(name, folder, formats, category):
    """Files of a figure or a table; the first format goes into the report."""
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


rule record_configuration:
    """Write the resolved configuration beside the results."""
    input:
        library=modules_of("record_configuration.py"),
    output:
        config=result("config.json"),
    log:
        log_of("record_configuration.log"),
    benchmark:
        benchmark_of("record_configuration.tsv")
    threads: 1
    resources:
        mem_mb=500,
    params:
        config=config,
    message:
        "Recording the configuration"
    script:
        "../scripts/record_configuration.py"


for _notebook in NOTEBOOKS:

    rule:
        name:
            f"run_{_notebook}"
        input:
            results=read_by(_notebook),
            notebook=f"notebooks/{_notebook}.ipynb",
            library=modules_of("run_notebook.py", f"notebooks/{_notebook}.ipynb"),
        output:
            figures=figures_of(_notebook),
            tables=tables_of(_notebook),
            executed=result("notebooks", f"{_notebook}.ipynb"),
            html=in_report(
                result("notebooks", f"{_notebook}.html"),
                "Notebooks",
                _notebook,
                caption="notebook",
            ),
        log:
            log_of("notebooks", f"{_notebook}.log"),
        benchmark:
            benchmark_of("notebooks", f"{_notebook}.tsv")
        threads: 1
        resources:
            mem_mb=1500,
        params:
            parameters={"results": str(RESULTS), "figures": str(FIGURES)},
        message:
            f"Running the notebook {_notebook}"
        script:
            "../scripts/run_notebook.py"
