# Compare: scores of the laws with dependence on held-out records, and the effect of the quality of the data on the
# answer (beyond the paper).
#
# In: encounters.parquet, the fitted family, the crash map of the vehicle under test. Out: the table of laws and of
# alternative laws, and the answer for other treatments of the records.

OF_LAWS = {
    "encounters": rules.ingest_encounters.output.encounters,
    "family": rules.fit_family.output.family,
    "map": f"{FOLDERS['under_test']}/crash_map/full.npz",
    "vehicle": ancient(local(VEHICLE_FILES)),
}


rule compare_laws:
    """Score every law and its alternatives on held-out records near the crash set."""
    input:
        **OF_LAWS,
    output:
        laws=result("laws", "laws.csv"),
    log:
        log_of("compare_laws.log"),
    benchmark:
        benchmark_of("compare_laws.tsv")
    threads: WORKERS
    params:
        **UNDER_TEST,
        seed=config["seed"],
        draws=config["answer"]["draws"],
        closing_speed_max=config["answer"]["grid"]["closing_speed_max"],
        support=SUPPORT,
        library=code_up_to("answer", *SIMULATING),
    message:
        "Comparing the laws with dependence and alternative laws"
    script:
        "../scripts/compare_laws.py"


rule compare_record_variants:
    """Compute the answer again for other treatments of the records, which leave out or change some of them."""
    input:
        **OF_LAWS,
    output:
        data_quality=result("laws", "data_quality.csv"),
        choices=result("laws", "choices.csv"),
        far_records=result("laws", "far_records.csv"),
        host_limit=result("laws", "host_limit.csv"),
        near_miss_answer=result("laws", "near_miss_answer.csv"),
        margins=result("laws", "margins.csv"),
    log:
        log_of("compare_record_variants.log"),
    benchmark:
        benchmark_of("compare_record_variants.tsv")
    threads: WORKERS
    params:
        **UNDER_TEST,
        scenario=config["scenario"],
        seed=config["seed"],
        draws=config["answer"]["draws"],
        support=SUPPORT,
        outlier_rows=INPUTS.source["outlier_rows"],
        library=code_up_to("answer", *SIMULATING),
    message:
        "Computing the answer for other treatments of the records"
    script:
        "../scripts/compare_record_variants.py"
