# Conclude: the article of the study of cut-ins, and whether its records can be trusted.
#
# In: the book, the published tables and figures, the report on the records. Out: article.pdf, which is made only if it
# is asked for (make article), and records_verdict.txt.

from accelerated_evaluation.publishing.article.text import BENCHMARKS, shown_figures

ARTICLE = PROJECT / "article"


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
