# Collect: the tables of all methods in one.
#
# In: the traces of all searches, the estimates and the coverage of every method. Out: the same rows, in one table of
# each kind.

COLLECTED = {
    "traces": {"cross_entropy_trace": searched("_trace.csv", *SEARCHING)},
    "estimates": {
        "estimates": estimates_of("estimates"),
        "estimates_course": estimates_of("course"),
    },
    "coverage": {
        "coverage": [result("coverage", f"{judged}.csv") for judged in JUDGED]
    },
}

for _collected, _tables in COLLECTED.items():

    rule:
        name:
            f"collect_{_collected}"
        input:
            **_tables,
        output:
            **{table: result(f"{table}.csv") for table in _tables},
        log:
            log_of(f"collect_{_collected}.log"),
        benchmark:
            benchmark_of(f"collect_{_collected}.tsv")
        params:
            library=code_up_to("base"),
        message:
            f"Collecting the {_collected} of all methods"
        script:
            "../scripts/collect_tables.py"
