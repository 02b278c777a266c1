# Sampled: the answer for a slow vehicle from about 150 simulations, compared with fast references (simulations.slow).
#
# In: encounters.parquet, the fitted family, the slow vehicle, maps of the references. Out: the answer with its budget and
# rates, the simulations and their crashes, the comparison with each reference, the calibration of the laws, and
# the most probable crashes over time.

FAST = [name for name in MAPPED_VEHICLES if name != "under_test"]


rule sample_answer:
    """Estimate the answer for a slow vehicle from chosen simulations, whose outcomes are stored.

    An interrupted job uses the stored outcomes when it is started again.
    """
    input:
        encounters=rules.ingest_encounters.output.encounters,
        exposure=rules.ingest_encounters.output.exposure,
        family=rules.fit_family.output.family,
        vehicle=ancient(VEHICLE_FILES),
    output:
        answer=result("laws", "answer.csv"),
        budget=result("laws", "answer_budget.csv"),
        draws=result("laws", "answer_draws.csv"),
        exposure=result("laws", "exposure.csv"),
        extrapolation=result("laws", "extrapolation.csv"),
        law=result("laws", "answer.json"),
        estimate=result("sampled", "estimate.csv"),
        runs=result("sampled", "runs.csv"),
        crashes=result("sampled", "crashes.csv"),
        replays=result("sampled", "replays.csv"),
    log:
        log_of("sample_answer.log"),
    benchmark:
        benchmark_of("sample_answer.tsv")
    threads: WORKERS
    resources:
        mem_mb=2000,
    params:
        settings=part(
            config,
            "study",
            "seed",
            "vehicle",
            "importance_sampling",
            "surrogate",
            "answer",
        ),
        vehicle_content=VEHICLE_CONTENT,
        simulations=SIMULATIONS,
        support=SUPPORT,
        library=code_up_to("answer"),
    message:
        "Simulating {params.settings[vehicle][name]} in cut-ins chosen for the answer"
    script:
        "../scripts/sample_answer.py"


rule compare_sampled:
    """Compare the slow vehicle with the references under the same draws of the law, and the laws with the records."""
    input:
        encounters=rules.ingest_encounters.output.encounters,
        family=rules.fit_family.output.family,
        law=rules.sample_answer.output.law,
        draws=rules.sample_answer.output.draws,
        maps=[f"{FOLDERS[name]}/crash_map/full.npz" for name in FAST],
        vehicles=ancient(INPUTS.files_of(*FAST)),
    output:
        vehicles=result("laws", "vehicles.csv"),
        compared=result("sampled", "compared.csv"),
        calibration=result("laws", "calibration.csv"),
    log:
        log_of("compare_sampled.log"),
    benchmark:
        benchmark_of("compare_sampled.tsv")
    threads: 1
    resources:
        mem_mb=3000,
    params:
        seed=config["seed"],
        draws=config["answer"]["draws"],
        vehicles={name: VEHICLES[name] for name in FAST},
        vehicle_content=INPUTS.content_of(*FAST),
        simulations=SIMULATIONS,
        support=SUPPORT,
        library=code_up_to("answer"),
    message:
        "Comparing the vehicle under test with references under the same draws"
    script:
        "../scripts/compare_sampled.py"


rule replay_crashes:
    """Repeat the simulations of the most probable crashes, about a dozen, and record the states over time."""
    input:
        crashes=rules.sample_answer.output.crashes,
        answer=rules.sample_answer.output.answer,
        vehicle=ancient(VEHICLE_FILES),
    output:
        encounters=result("happened", "encounters.csv"),
        traces=result("happened", "traces.csv"),
    log:
        log_of("replay_crashes.log"),
    benchmark:
        benchmark_of("replay_crashes.tsv")
    threads: WORKERS
    resources:
        mem_mb=1000,
    params:
        seed=config["seed"],
        vehicle=config["vehicle"],
        vehicle_content=VEHICLE_CONTENT,
        simulations=SIMULATIONS,
        library=code_up_to("answer"),
    message:
        "Simulating the most probable crashes again"
    script:
        "../scripts/replay_crashes.py"
