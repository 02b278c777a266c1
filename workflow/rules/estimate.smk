# Estimate: the crash probability by importance sampling (paper, sections IV and VI.C).
#
# In: encounters.parquet, the model under study, the vehicle, f* of every seed. Out: an estimate for each
# replicate at convergence, and the course of its interval, over all segments and in the first one alone.


rule estimate_crash_probability:
    """Estimate the crash probability in independent replicates with fresh samples."""
    input:
        encounters=rules.ingest_encounters.output.encounters,
        model=rules.fit_models.output[MODEL],
        proposals=expand(
            rules.search_proposals.output.proposals, seed=SEEDS, allow_missing=True
        ),
        vehicle=ancient(VEHICLE_FILES),
        library=modules_of("estimate_crash_probability.py"),
    output:
        estimates=result("importance_sampling", "{scope}_{method}.csv"),
        course=result("importance_sampling", "{scope}_{method}_course.csv"),
    log:
        log_of("estimate_crash_probability", "{scope}_{method}.log"),
    benchmark:
        benchmark_of("estimate_crash_probability", "{scope}_{method}.tsv")
    threads: 1
    resources:
        mem_mb=1000,
    params:
        study=STUDY,
        seed=config["seed"],
        vehicle=config["vehicle"],
        vehicle_content=VEHICLE_CONTENT,
        importance_sampling=config["importance_sampling"],
    message:
        "Importance sampling, method {wildcards.method}, segments {wildcards.scope}"
    script:
        "../scripts/estimate_crash_probability.py"


rule collect_estimates:
    """Join the estimates of all methods, and their courses."""
    input:
        estimates=expand(
            rules.estimate_crash_probability.output.estimates,
            scope=["all", SEGMENTS[0]],
            method=METHODS,
        ),
        course=expand(
            rules.estimate_crash_probability.output.course,
            scope=["all", SEGMENTS[0]],
            method=METHODS,
        ),
        library=modules_of("collect_tables.py"),
    output:
        estimates=result("estimates.csv"),
        course=result("estimates_course.csv"),
    log:
        log_of("collect_estimates.log"),
    benchmark:
        benchmark_of("collect_estimates.tsv")
    threads: 1
    resources:
        mem_mb=500,
    message:
        "Collecting the estimates"
    script:
        "../scripts/collect_tables.py"
