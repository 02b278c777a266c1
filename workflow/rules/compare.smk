# Compare: how the laws with dependence predict records that they have not seen, and what the quality of the data does to
# the answer (beyond the paper).
#
# In: encounters.parquet, the fitted family, the crash map of the vehicle under test. Out: the table of laws with their
# rivals, and the answer for other choices of data quality.

OF_LAWS = {
    "encounters": rules.ingest_encounters.output.encounters,
    "family": rules.fit_family.output.family,
    "map": f"{FOLDERS['under_test']}/crash_map/full.npz",
    "vehicle": ancient(VEHICLE_FILES),
}


rule compare_laws:
    """Score every law and its rivals on held-out records near the crash set."""
    input:
        **OF_LAWS,
        library=modules_of("compare_laws.py", members=OF_VEHICLE),
    output:
        laws=result("laws", "laws.csv"),
    log:
        log_of("compare_laws.log"),
    benchmark:
        benchmark_of("compare_laws.tsv")
    threads: WORKERS
    resources:
        mem_mb=2000,
    params:
        seed=config["seed"],
        vehicle=config["vehicle"],
        vehicle_content=VEHICLE_CONTENT,
        simulations=SIMULATIONS,
        draws=config["answer"]["draws"],
        support=SUPPORT,
    message:
        "Comparing the laws with dependence and their rivals"
    script:
        "../scripts/compare_laws.py"


rule compare_record_variants:
    """Answer again from the records as other choices of data quality leave them."""
    input:
        **OF_LAWS,
        library=modules_of("compare_record_variants.py", members=OF_VEHICLE),
    output:
        data_quality=result("laws", "data_quality.csv"),
    log:
        log_of("compare_record_variants.log"),
    benchmark:
        benchmark_of("compare_record_variants.tsv")
    threads: WORKERS
    resources:
        mem_mb=2000,
    params:
        seed=config["seed"],
        vehicle=config["vehicle"],
        vehicle_content=VEHICLE_CONTENT,
        simulations=SIMULATIONS,
        answer=part(config["answer"], "draws", "quality_draws"),
        support=SUPPORT,
        outlier_rows=INPUTS.source["outlier_rows"],
    message:
        "Answering from the records for other choices of data quality"
    script:
        "../scripts/compare_record_variants.py"
