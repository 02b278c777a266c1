# Numbers: the named numbers of a study, which the README, the guides and the article state.
#
# In: the published tables, the tables of the benchmarks. Out: numbers.csv, if the study publishes all tables that it needs.

from accelerated_evaluation.publishing.book.catalogue import tables_of_numbers

DEFINITIONS = PROJECT / "workflow/numbers.yaml"
NAMED_FROM = tables_of_numbers(DEFINITIONS)
PUBLISHED = {name for made in NOTEBOOKS.values() for name in made.tables}
NAMED_NUMBERS = (
    [str(FIGURES / "numbers.csv")] if PUBLISHED.issuperset(NAMED_FROM["tables"]) else []
)


if NAMED_NUMBERS:

    rule name_numbers:
        """Publish the numbers that texts state, each with its unit, its kind and its subject."""
        input:
            definitions=local([str(DEFINITIONS)]),
            tables=[
                str(FIGURES / "tables" / f"{name}.csv")
                for name in NAMED_FROM["tables"]
            ],
            benchmarks=[
                of_project("benchmarks/results", f"{name}.csv")
                for name in NAMED_FROM["results"]
            ],
            config=result("config.json"),
        output:
            NAMED_NUMBERS,
        log:
            log_of("name_numbers.log"),
        benchmark:
            benchmark_of("name_numbers.tsv")
        params:
            study=folders_of_study,
            library=code_up_to("publishing"),
        message:
            "Naming the numbers of the texts"
        script:
            "../scripts/write_numbers.py"
