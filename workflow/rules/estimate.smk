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
            vehicle=ancient(local(VEHICLE_FILES)),
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
            **plan_of(_method),
            study=STUDY,
            seed=config["seed"],
            method=_method,
            settings=settings_of(_method),
            library=code_up_to("methods", *UNDER_PAPER, f"methods/{_method}"),
        message:
            f"Estimating by the method {_method}, segments {{wildcards.scope}}"
        script:
            "../scripts/estimate_probability.py"
