# Article: a preprint of a study, which is made only on request (make article).
#
# In: the published tables and figures, the tables of the benchmarks. Out: article.pdf.


rule article:
    """Make an article of the study: a PDF whose numbers and figures are all published results."""
    input:
        text=local(sorted(map(str, ARTICLE.iterdir()))),
        figures=shown_in_article,
        captions=local(
            [str(CAPTIONS / f"{name}.rst") for name in shown_figures(ARTICLE)]
        ),
        tables=[file for name in NOTEBOOKS for file in tables_of(name)],
        benchmarks=[
            of_project("benchmarks/results", f"{name}.csv")
            for name in NAMED_FROM["results"]
        ],
        numbers=NAMED_NUMBERS,
        config=result("config.json"),
    output:
        result("article.pdf"),
    log:
        log_of("article.log"),
    benchmark:
        benchmark_of("article.tsv")
    params:
        study=folders_of_study,
        library=code_up_to("publishing"),
    message:
        "Writing the article"
    script:
        "../scripts/write_article.py"
