# Accelerate: the Cross-Entropy search for f* (paper, section V).
#
# In: encounters.parquet (for v_L), the model under study, the vehicle. Out: for each method and seed the
# accelerated distributions of all segments, and the trace of every iteration.


rule search_proposals:
    """Search for the accelerated distributions of one method for every seed, segment by segment.

    One job makes all searches of a method, because a search takes less time than the start of a process.
    """
    input:
        encounters=rules.ingest_encounters.output.encounters,
        model=rules.fit_models.output[MODEL],
        vehicle=ancient(local(VEHICLE_FILES)),
    output:
        proposals=searched(".json", "{method}"),
        trace=searched("_trace.csv", "{method}"),
    log:
        log_of("search_proposals", "{method}.log"),
    benchmark:
        benchmark_of("search_proposals", "{method}.tsv")
    threads: WORKERS
    params:
        **UNDER_TEST,
        seed=config["seed"],
        seeds=[*SEEDS],
        settings=lambda wildcards: settings_of(wildcards.method),
        library=lambda wildcards: code_up_to(
            "methods", *UNDER_PAPER, f"methods/{wildcards.method}"
        ),
    message:
        "Cross-Entropy searches, method {wildcards.method}"
    script:
        "../scripts/search_proposals.py"
