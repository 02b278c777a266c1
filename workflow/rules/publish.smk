# Publish: notebooks, one for each section of the paper, which make figures and tables from finished results, and the
# book of all notebooks.
#
# In: everything under results/<study>/. Out: figures/<study>/*.{pdf,svg,png,csv}, figures/<study>/tables/*, the
# executed notebooks, also for reading in figures/<study>/notebooks, and the book. The metadata of each notebook declare its inputs and outputs.

PAGES = PROJECT / "workflow/book"  # templates of the first and the last page


rule record_configuration:
    """Write the resolved configuration, and the list of the results of the study."""
    output:
        config=result("config.json"),
        contents=result("contents.json"),
    log:
        log_of("record_configuration.log"),
    benchmark:
        benchmark_of("record_configuration.tsv")
    params:
        config=config,
        contents=MADE,
        library=code_up_to("base"),
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
            captions=captions_of(_notebook),
        output:
            figures=figures_of(_notebook),
            tables=tables_of(_notebook),
            executed=result("notebooks", f"{_notebook}.ipynb"),
            rendered=rendered_of(_notebook),
        log:
            log_of("notebooks", f"{_notebook}.log"),
        benchmark:
            benchmark_of("notebooks", f"{_notebook}.tsv")
        params:
            parameters=folders_of_study,
            library=code_up_to("publishing", *SHOWN),
        message:
            f"Running the notebook {_notebook}"
        script:
            "../scripts/run_notebook.py"


for _figure in OWN_FIGURES:

    rule:
        name:
            f"draw_{_figure}"
        input:
            results=[result(name) for name in READ_BY_OWN[_figure]],
        output:
            files_of_own(_figure),
        log:
            log_of("figures", f"{_figure}.log"),
        benchmark:
            benchmark_of("figures", f"{_figure}.tsv")
        params:
            figure=_figure,
            study=folders_of_study,
            library=code_up_to("publishing", f"publishing/figures/{_figure}"),
        message:
            f"Drawing {_figure}"
        script:
            "../scripts/draw_figure.py"


if HAS_EXPLORER:

    rule explorer:
        """Make the explorer, a page on which a reader can change the vehicle, the law of encounters and the event."""
        input:
            encounters=rules.ingest_encounters.output.encounters,
            exposure=rules.ingest_encounters.output.exposure,
            law=(
                rules.fit_family.output.family
                if SUPPORT
                else rules.study_answer.output.draws
            ),
            map=[
                f"{FOLDERS[name]}/crash_map/full.npz"
                for name in MAPPED_VEHICLES[:1]
                if name == "under_test"
            ],
            runs=[rules.study_answer.output.runs] if SLOW else [],
            answer=result("laws", "answer.csv"),
            vehicles=result("laws", "vehicles.csv"),
            templates=local(sorted(map(str, (PROJECT / "workflow/explorer").iterdir()))),
        output:
            page=result("explorer.html"),
        log:
            log_of("explorer.log"),
        benchmark:
            benchmark_of("explorer.tsv")
        priority: 60
        params:
            config=part(config, "seed", "study", "scenario", "vehicle", "answer"),
            support=SUPPORT,
            library=code_up_to("publishing", *SIMULATING),
        message:
            "Making the explorer"
        script:
            "../scripts/build_explorer.py"

else:

    rule explorer:
        """Say why there is no explorer."""
        input:
            no_explorer,
        output:
            page=result("explorer.html"),


rule book:
    """Make the book, a web site with the executed notebooks and the guides, and the provenance of the study."""
    input:
        notebooks=[result("notebooks", f"{notebook}.ipynb") for notebook in NOTEBOOKS],
        published=[
            file
            for name in NOTEBOOKS
            for file in [*figures_of(name), *tables_of(name), rendered_of(name)]
        ]
        + [file for name in OWN_FIGURES for file in files_of_own(name)]
        + NAMED_NUMBERS,
        results=[
            result(name) for name in ("config.json", "contents.json", *ON_FIRST_PAGE)
        ],
        guides=local(GUIDES),
        pictures=local(PICTURES),
        captions=local(sorted(map(str, CAPTIONS.glob("*.rst")))),
        pages=local(sorted(map(str, PAGES.iterdir()))),
        explorer=[rules.explorer.output.page] if HAS_EXPLORER else [],
    output:
        site=directory(result("book")),
        provenance=result("provenance.json"),
    log:
        log_of("book.log"),
    benchmark:
        benchmark_of("book.tsv")
    params:
        study=folders_of_study,
        tables={name: made.tables for name, made in NOTEBOOKS.items()},
        added=list(OWN_FIGURES),
        records=RECORDS,
        library=code_up_to("publishing"),
    message:
        "Making the book"
    script:
        "../scripts/build_book.py"
