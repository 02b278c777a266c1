# Ground truth: the exact crash probability, its sensitivity and its uncertainty (beyond the paper).
#
# In: the vehicle, the models, the encounters, f* of every search. Out: the crash map, exact probabilities with
# their error, the exact variation of every f*, severity, sensitivity and the budget of uncertainty; longer searches.


MAPPED = INPUTS.mapped("under_test", config["crash_map"])
MAP_FOLDER = map_folder(MAPPED)


rule map_crashes:
    """Compute the crash map of the vehicle, which does not depend on a model, at full, half and quarter resolution."""
    input:
        vehicle=ancient(local(VEHICLE_FILES)),
    output:
        full=f"{MAP_FOLDER}/crash_map/full.npz",
        half=f"{MAP_FOLDER}/crash_map/half.npz",
        quarter=f"{MAP_FOLDER}/crash_map/quarter.npz",
        vehicle=f"{MAP_FOLDER}/vehicle.json",
    log:
        f"{MAP_FOLDER}/logs/map_crashes.log",
    benchmark:
        f"{MAP_FOLDER}/benchmarks/map_crashes.tsv"
    threads: WORKERS
    params:
        mapped=MAPPED,
        checked=True,
        vehicle=config["vehicle"],
        simulations=SIMULATIONS,
        library=code_up_to("crash_map", "scenarios", "vehicles"),
    message:
        "Mapping the crashes of {params.mapped[vehicle]}"
    script:
        "../scripts/map_crashes.py"


rule compute_exact:
    """Compute exact probabilities, severity, and the variation of every f* from the maps and the models."""
    input:
        **rules.fit_models.output,
        full=rules.map_crashes.output.full,
        half=rules.map_crashes.output.half,
        quarter=rules.map_crashes.output.quarter,
        encounters=rules.ingest_encounters.output.encounters,
        exposure=rules.ingest_encounters.output.exposure,
        proposals=searched(".json", *SEARCHING),
    output:
        exact=result("exact.csv"),
        convergence=result("convergence.csv"),
        severity=result("severity.csv"),
        impact_speed=result("impact_speed.csv"),
        variation=result("variation.csv"),
    log:
        log_of("compute_exact.log"),
    benchmark:
        benchmark_of("compute_exact.tsv")
    params:
        methods=[method for method in SEARCHING for _ in SEEDS],
        seeds=[seed for _ in SEARCHING for seed in SEEDS],
        variant=MODEL,
        library=code_up_to("methods", *UNDER_PAPER),
    message:
        "Computing exact probabilities"
    script:
        "../scripts/compute_exact.py"


rule repeat_searches:
    """Search f* of the first segment with more seeds and more updates, and judge it by its exact variance."""
    input:
        encounters=rules.ingest_encounters.output.encounters,
        model=rules.fit_models.output[MODEL],
        quarter=rules.map_crashes.output.quarter,
        vehicle=ancient(local(VEHICLE_FILES)),
    output:
        repeated=result("repeated_searches.csv"),
    log:
        log_of("repeat_searches.log"),
    benchmark:
        benchmark_of("repeat_searches.tsv")
    threads: WORKERS
    params:
        **UNDER_TEST,
        seed=config["seed"],
        segment=SEGMENTS[0],
        methods=SEARCHING,
        settings=part(config, "cross_entropy", "importance_sampling"),
        stopping=asdict(configured_stopping(config["importance_sampling"])),
        library=code_up_to(
            "methods", *UNDER_PAPER, *(f"methods/{name}" for name in SEARCHING)
        ),
    message:
        "Cross-Entropy searches with more updates, segment {params.segment}"
    script:
        "../scripts/repeat_searches.py"


rule study_sensitivity:
    """Change one choice at a time, and tabulate the exact crash probability."""
    input:
        **rules.fit_models.output,
        full=rules.map_crashes.output.full,
        half=rules.map_crashes.output.half,
        encounters=rules.ingest_encounters.output.encounters,
        vehicle=ancient(local(VEHICLE_FILES)),
    output:
        sensitivity=result("sensitivity.csv"),
    log:
        log_of("study_sensitivity.log"),
    benchmark:
        benchmark_of("study_sensitivity.tsv")
    threads: WORKERS
    params:
        **UNDER_TEST,
        seed=config["seed"],
        variant=MODEL,
        sensitivity=config["sensitivity"] | part(INPUTS.source, "outlier_rows"),
        library=code_up_to("crash_map", *UNDER_PAPER),
    message:
        "Computing the crash probability with one choice changed at a time"
    script:
        "../scripts/study_sensitivity.py"


rule bootstrap_uncertainty:
    """Refit the model to resampled lane changes, and set up the budget of the uncertainty."""
    input:
        **{name: rules.fit_models.output[name] for name in PIECEWISE},
        half=rules.map_crashes.output.half,
        encounters=rules.ingest_encounters.output.encounters,
    output:
        uncertainty=result("uncertainty.csv"),
        bootstrap=result("bootstrap.csv"),
    log:
        log_of("bootstrap_uncertainty.log"),
    benchmark:
        benchmark_of("bootstrap_uncertainty.tsv")
    params:
        seed=config["seed"],
        variant=MODEL,
        alpha=config["importance_sampling"]["alpha"],
        replicates=config["uncertainty"]["replicates"],
        library=code_up_to("crash_map", *UNDER_PAPER),
    message:
        "Resampling the lane changes, {params.replicates} refits"
    script:
        "../scripts/bootstrap_uncertainty.py"
