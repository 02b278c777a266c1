# Publish: one notebook a section of the paper, each making its figures and tables from finished results, and the
# book of them all.
#
# In: everything under results/<study>/. Out: figures/<study>/*.{pdf,svg,png,csv}, figures/<study>/tables/*, the
# executed notebooks and the book. What each notebook reads and makes is found out from its code. The article is made
# from the published tables and figures, and only if it is asked for: make article.

from accelerated_evaluation.publishing.article.text import BENCHMARKS, shown_figures

ARTICLE = PROJECT / "article"


rule record_configuration:
    """Write the resolved configuration into the folder of the results."""
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
            notebook=notebook_of(_notebook),
            library=modules_of("run_notebook.py", notebook_of(_notebook)),
        output:
            figures=figures_of(_notebook),
            tables=tables_of(_notebook),
            executed=result("notebooks", f"{_notebook}.ipynb"),
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


rule book:
    """Make one site of the executed notebooks and the guides."""
    input:
        notebooks=[result("notebooks", f"{notebook}.ipynb") for notebook in NOTEBOOKS],
        published=[file for name in NOTEBOOKS for file in figures_of(name)]
        + [file for name in NOTEBOOKS for file in tables_of(name)],
        results=[
            result(name)
            for name in (
                "config.json",
                "records_report.csv",
                "laws/answer.csv",
                "exact.csv",
                "crude.csv",
            )
        ],
        guides=sorted(map(str, (PROJECT / "docs").glob("*.md"))),
        captions=sorted(map(str, CAPTIONS.glob("*.rst"))),
        pages=sorted(map(str, (PROJECT / "workflow/book").iterdir())),
        library=modules_of("build_book.py"),
    output:
        site=directory(result("book")),
    log:
        log_of("book.log"),
    benchmark:
        benchmark_of("book.tsv")
    threads: 1
    resources:
        mem_mb=1500,
    params:
        study={"results": str(RESULTS), "figures": str(FIGURES)},
        tables={name: made.tables for name, made in NOTEBOOKS.items()},
        records=RECORDS,
    message:
        "Making the book"
    script:
        "../scripts/build_book.py"


rule article:
    """Make an article of the study: a PDF whose numbers and figures are all published results."""
    input:
        text=sorted(map(str, ARTICLE.iterdir())),
        figures=[str(FIGURES / f"{name}.pdf") for name in shown_figures(ARTICLE)],
        captions=[str(CAPTIONS / f"{name}.rst") for name in shown_figures(ARTICLE)],
        tables=[file for name in NOTEBOOKS for file in tables_of(name)],
        benchmarks=[
            str(PROJECT / "benchmarks/results" / f"{name}.csv") for name in BENCHMARKS
        ],
        config=result("config.json"),
        library=modules_of("write_article.py"),
    output:
        pdf=result("article.pdf"),
        numbers=result("article.json"),
    log:
        log_of("article.log"),
    benchmark:
        benchmark_of("article.tsv")
    threads: 1
    resources:
        mem_mb=1000,
    params:
        study={"results": str(RESULTS), "figures": str(FIGURES)},
    message:
        "Writing the article"
    script:
        "../scripts/write_article.py"


rule accept_records:
    """End with an error if a check of the records says stop and the user does not accept it by name.

    The results are made first, so that one can see what the fault does to them.
    """
    input:
        report=rules.inspect_records.output.report,
        finished=rules.book.output.site,
        library=modules_of("accept_records.py"),
    output:
        verdict=result("records_verdict.txt"),
    log:
        log_of("accept_records.log"),
    benchmark:
        benchmark_of("accept_records.tsv")
    threads: 1
    resources:
        mem_mb=500,
    params:
        accepted=ACCEPTED,
        records=INPUTS.source["path"],
    message:
        "Asking whether the records can be trusted"
    script:
        "../scripts/accept_records.py"
