# Ingest: from the records to the table of encounters (paper, section II).
#
# In: the records that the configuration names. Out: encounters.parquet, the account of every row that was left out, the
# kilometres and hours in which the records were made; for cut-ins the counts of the segments and the test of
# independence within them.


rule ingest_encounters:
    """Read the records, filter and segment lane changes, and account for every row."""
    input:
        records=ancient(local(RECORDS)),
    output:
        encounters=result("encounters.parquet"),
        account=result("encounters_account.csv"),
        exposure=result("exposure.json"),
    log:
        messages=log_of("ingest_encounters.log"),
        account=log_of("ingest_encounters_account.csv"),
    benchmark:
        benchmark_of("ingest_encounters.tsv")
    priority: 90
    params:
        seed=config["seed"],
        content=content_of_records,
        scenario=config["scenario"],
        data=config["data"],
        filters=config["filters"],
        segments=config["segments"],
        library=code_up_to("scenarios", "records/sources", "scenarios"),
    message:
        "Ingesting the records"
    script:
        "../scripts/ingest_encounters.py"


if SUPPORT:

    rule describe_encounters:
        """Count the segments, and test whether variables are independent inside them and whether they are similar."""
        input:
            encounters=rules.ingest_encounters.output.encounters,
        output:
            segments=result("segments.csv"),
            dependence=result("dependence.csv"),
            similarity=result("similarity.csv"),
        log:
            log_of("describe_encounters.log"),
        benchmark:
            benchmark_of("describe_encounters.tsv")
        params:
            library=code_up_to("records", "records/sources"),
        message:
            "Testing the independence of v_L, R^-1 and TTC^-1, and the similarity of the segments"
        script:
            "../scripts/describe_encounters.py"
