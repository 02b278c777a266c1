# Inspect: checks of the records of any scenario, before any result is computed.
#
# In: the records that the configuration names. Out: the report on the records.


rule inspect_records:
    """Check the records before any other job, and print checks with a warning or a stop; see `accept_records`."""
    input:
        records=ancient(local(RECORDS)),
        vehicle=ancient(local(VEHICLE_FILES)),
    output:
        report=result("records_report.csv"),
    log:
        log_of("inspect_records.log"),
    benchmark:
        benchmark_of("inspect_records.tsv")
    priority: 100  # faults of the records are shown first; the longest chain of jobs starts afterwards
    threads: WORKERS
    params:
        **UNDER_TEST,
        seed=config["seed"],
        content=content_of_records,
        scenario=config["scenario"],
        data=config["data"],
        filters=config["filters"],
        segments=config["segments"],
        replays=not SLOW,
        library=code_up_to("vehicles", "records", "scenarios", "vehicles"),
    message:
        "Checking the records of the study"
    script:
        "../scripts/inspect_records.py"
