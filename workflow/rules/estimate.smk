# Estimate: the crash probability by every method of the configuration (paper, sections IV and VI.C, and beyond).
#
# In: encounters.parquet, the law under study, the vehicle, and f* of every seed for methods that search. Out: for each
# method an estimate for each replicate, and the tables of the method, over all segments and in the first one alone.


for _method in REPLICATED:

    rule:
        name:
            f"estimate_{_method}"
        input:
            encounters=rules.ingest_encounters.output.encounters,
            model=rules.fit_models.output[MODEL],
            proposals=(
                searched(".json", _method) if METHODS[_method].learns_apart else []
            ),
            vehicle=ancient(VEHICLE_FILES),
        output:
            **{
                table: result("estimates", f"{{scope}}_{_method}_{table}.csv")
                for table in METHODS[_method].tables
            },
            estimates=result("estimates", f"{{scope}}_{_method}.csv"),
        log:
            log_of(f"estimate_{_method}", "{scope}.log"),
        benchmark:
            benchmark_of(f"estimate_{_method}", "{scope}.tsv")
        threads: WORKERS
        params:
            **UNDER_TEST,
            study=STUDY,
            seed=config["seed"],
            method=_method,
            settings=settings_of(_method),
            stopping=asdict(METHODS[_method].stopping(config)),
            replicates=METHODS[_method].replicates(config),
            library=code_up_to("methods"),
        message:
            f"Estimating by the method {_method}, segments {{wildcards.scope}}"
        script:
            "../scripts/estimate_probability.py"


rule collect_estimates:
    """Join the estimates of all methods, the courses of those that have one, and the runs of the others."""
    input:
        estimates=estimates_of("estimates"),
        course=estimates_of("course"),
        runs=estimates_of("runs"),
    output:
        estimates=result("estimates.csv"),
        course=result("estimates_course.csv"),
        runs=result("estimates_runs.csv"),
    log:
        log_of("collect_estimates.log"),
    benchmark:
        benchmark_of("collect_estimates.tsv")
    params:
        library=code_up_to("base"),
    message:
        "Collecting the estimates"
    script:
        "../scripts/collect_tables.py"
