# Judge: crude Monte Carlo with as many simulations as it needs, and coverage of each method's intervals (beyond the
# paper).
#
# In: the model, the vehicle, f* of every search, the exact probability. Out: the crude estimate and its course;
# for each method bias, variation and coverage over many replicates, for fixed sizes and for stopping rules.


rule run_crude_monte_carlo:
    """Estimate the crash probability by crude Monte Carlo, with the number of simulations that the paper extrapolates."""
    input:
        encounters=rules.ingest_encounters.output.encounters,
        model=rules.fit_models.output[MODEL],
        vehicle=ancient(local(VEHICLE_FILES)),
    output:
        estimates=result("crude.csv"),
        course=result("crude_course.csv"),
    log:
        log_of("run_crude_monte_carlo.log"),
    benchmark:
        benchmark_of("run_crude_monte_carlo.tsv")
    threads: WORKERS
    params:
        **UNDER_TEST,
        seed=config["seed"],
        crude_monte_carlo=config["crude_monte_carlo"],
        alpha=config["importance_sampling"]["alpha"],
        library=code_up_to("methods", *UNDER_PAPER),
    message:
        "Crude Monte Carlo, {params.crude_monte_carlo[simulations]} simulations"
    script:
        "../scripts/run_crude_monte_carlo.py"


rule study_coverage:
    """Compute the coverage of one method's intervals in many replicates, by the exact probability."""
    input:
        encounters=rules.ingest_encounters.output.encounters,
        model=rules.fit_models.output[MODEL],
        exact=rules.compute_exact.output.exact,
        proposals=lambda wildcards: (
            searched(".json", wildcards.judged)
            if wildcards.judged in SEARCHING
            else []
        ),
        vehicle=ancient(local(VEHICLE_FILES)),
    output:
        coverage=result("coverage", "{judged}.csv"),
        replicates=result("coverage", "{judged}_replicates.csv"),
    log:
        log_of("study_coverage", "{judged}.log"),
    benchmark:
        benchmark_of("study_coverage", "{judged}.tsv")
    threads: WORKERS
    params:
        **UNDER_TEST,
        seed=config["seed"],
        stopping=part(
            config["importance_sampling"],
            "alpha",
            "beta",
            "minimum_events",
            "maximum_simulations",
        ),
        coverage=config["coverage"],
        library=code_up_to("methods", *UNDER_PAPER),
    message:
        "Computing the coverage of the intervals of {wildcards.judged}"
    script:
        "../scripts/study_coverage.py"
