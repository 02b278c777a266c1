# Conclude: whether the records of the study can be trusted.
#
# In: the book, the report on the records. Out: records_verdict.txt.


rule accept_records:
    """End with an error if a check of the records has the verdict "stop", unless the configuration accepts this check.

    The results are made before, so that one can see the effect of the fault on them.
    """
    input:
        report=rules.inspect_records.output.report,
        finished=rules.book.output.site,
    output:
        verdict=result("records_verdict.txt"),
    log:
        log_of("accept_records.log"),
    benchmark:
        benchmark_of("accept_records.tsv")
    params:
        accepted=ACCEPTED,
        records=INPUTS.records.path,
        library=code_up_to("records", "records/checks"),
    message:
        "Checking whether a check of the records says stop"
    script:
        "../scripts/accept_records.py"
