# Surrogate: the crash probability from the fewest simulations (beyond the paper).
#
# In: encounters.parquet, the model under study, the vehicle. Out: an estimate for each replicate, learning included,
# and every simulation of every replicate, over all segments and in the first one alone.


rule sample_by_surrogate:
    """Estimate the crash probability in independent replicates that learn while they sample."""
    input:
        encounters=rules.ingest_encounters.output.encounters,
        model=rules.fit_models.output[MODEL],
        vehicle=ancient(VEHICLE_FILES),
        library=modules_of("sample_by_surrogate.py"),
    output:
        surrogate=result("surrogate.csv"),
        surrogate_runs=result("surrogate_runs.csv"),
    log:
        log_of("sample_by_surrogate.log"),
    benchmark:
        benchmark_of("sample_by_surrogate.tsv")
    threads: 1
    resources:
        mem_mb=1000,
    params:
        study=STUDY,
        seed=config["seed"],
        vehicle=config["vehicle"],
        vehicle_content=VEHICLE_CONTENT,
        criterion=part(config["importance_sampling"], "alpha", "beta"),
        lead_speed_edges=config["segments"]["lead_speed_edges"],
        surrogate=config["surrogate"],
    message:
        "Surrogate-guided sampling, {params.surrogate[replicates]} replicates"
    script:
        "../scripts/sample_by_surrogate.py"
