# Answer: laws of cut-ins that fit where crashes happen, and one crash probability with its interval (beyond the paper).
#
# In: encounters.parquet, the vehicles and their crash maps. Out: the answer with its budget, its law, and as rates per
# kilometre and hour; the calibration; and the most probable crashes and the most critical records over time.


rule study_laws:
    """Weight the laws, compute the answer for every event and vehicle, and the sources of its uncertainty."""
    input:
        encounters=rules.ingest_encounters.output.encounters,
        exposure=rules.ingest_encounters.output.exposure,
        family=rules.fit_family.output.family,
        maps=[f"{folder}/crash_map/full.npz" for folder in FOLDERS.values()],
        vehicles=ancient(ALL_FILES),
    output:
        answer=result("laws", "answer.csv"),
        exposure=result("laws", "exposure.csv"),
        vehicles=result("laws", "vehicles.csv"),
        answer_budget=result("laws", "answer_budget.csv"),
        answer_draws=result("laws", "answer_draws.csv"),
        answer_thresholds=result("laws", "answer_thresholds.csv"),
        calibration=result("laws", "calibration.csv"),
        crash_places=result("laws", "crash_places.csv"),
        extrapolation=result("laws", "extrapolation.csv"),
        near_misses=result("laws", "near_misses.csv"),
        injuries=result("laws", "injuries.csv"),
        injuries_by_curve=result("laws", "injuries_by_curve.csv"),
        injury_budget=result("laws", "injury_budget.csv"),
        injury_curves=result("laws", "injury_curves.csv"),
        risk_balance=result("laws", "risk_balance.csv"),
        law=result("laws", "answer.json"),
    log:
        log_of("study_laws.log"),
    benchmark:
        benchmark_of("study_laws.tsv")
    priority: 70
    threads: ALL_WORKERS
    resources:
        mem_mb=3000,
    params:
        seed=config["seed"],
        vehicles=VEHICLES,
        vehicle_content=ALL_CONTENT,
        simulations=ALL_SIMULATIONS,
        draws=config["answer"]["draws"],
        support=SUPPORT,
        half_width=config["importance_sampling"]["beta"],
        library=code_up_to("answer"),
    message:
        "Weighting the laws with dependence, and drawing the answer"
    script:
        "../scripts/study_laws.py"


rule replay_encounters:
    """Simulate the most probable crashes and the most critical records, and find which crashes are preventable."""
    input:
        encounters=rules.ingest_encounters.output.encounters,
        law=result("laws", "answer.json"),
        map=f"{FOLDERS['under_test']}/crash_map/full.npz",
        vehicles=ancient(ALL_FILES),
    output:
        encounters=result("happened", "encounters.csv"),
        traces=result("happened", "traces.csv"),
        preventable=result("happened", "preventable.csv"),
    log:
        log_of("replay_encounters.log"),
    benchmark:
        benchmark_of("replay_encounters.tsv")
    threads: ALL_WORKERS
    resources:
        mem_mb=2000,
    params:
        seed=config["seed"],
        tested="under test",
        vehicles={
            name.replace("under_test", "under test"): section
            for name, section in VEHICLES.items()
        },
        vehicle_content=ALL_CONTENT,
        simulations=ALL_SIMULATIONS,
        library=code_up_to("answer"),
    message:
        "Simulating the most probable crashes and the most critical records"
    script:
        "../scripts/replay_encounters.py"
