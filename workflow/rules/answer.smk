# Answer: laws of cut-ins that fit where crashes happen, and one crash probability with its interval (beyond the paper).
#
# In: encounters.parquet, the vehicle under test and those that it is compared with. Out: crash maps up to closing speeds
# where nothing changes any more, the answer with its budget, its law, and as rates per kilometre and hour, the
# calibration and the scores of all laws on records that they have not seen, what the quality of the data does to the
# answer, and what happens in the likeliest crashes and the nearest records.

NO_EVENTS = {name: [] for name in config["answer"]["events"]}
ANSWERED = {
    name: mapped(
        name,
        {
            "grid": config["answer"]["grid"],
            "events": (
                config["answer"]["events"] if name == "under_test" else NO_EVENTS
            ),
        },
    )
    for name in VEHICLES
}
ALL_FILES = [path for files in FILES.values() for path in files]
ALL_CONTENT = content_digest(ALL_FILES)
ALL_WORKERS, ALL_SIMULATIONS = simulating(*VEHICLES)
OF_VEHICLES = {"vehicles": [section["name"] for section in VEHICLES.values()]}
LAW_TABLES = {  # by job, so that they can run at the same time
    "answer": [
        "answer",
        "exposure",
        "vehicles",
        "answer_budget",
        "answer_draws",
        "answer_thresholds",
        "calibration",
        "crash_places",
    ],
    "score": ["laws"],
    "quality": ["data_quality"],
}

for _name, _description in ANSWERED.items():
    _workers, _simulations = simulating(_name)

    rule:
        name:
            f"map_crashes_{_name}"
        input:
            vehicle=ancient(FILES[_name]),
            library=modules_of(
                "map_crashes.py", members={"vehicles": [_description["vehicle"]]}
            ),
        output:
            full=map_of(_description, "crash_map/full.npz"),
            vehicle=map_of(_description, "vehicle.json"),
        log:
            map_of(_description, "logs/map_crashes.log"),
        benchmark:
            map_of(_description, "benchmarks/map_crashes.tsv")
        threads: _workers
        resources:
            mem_mb=2000,
        params:
            mapped=_description,
            # The maps of built-in vehicles are known; one of them has random closing speeds in the answer.
            checked=_name == "under_test" or bool(FILES[_name]),
            vehicle=VEHICLES[_name],
            simulations=_simulations,
        message:
            f"Mapping the crashes of {_name.replace('_', ' ')} without a cap on closing speeds"
        script:
            "../scripts/map_crashes.py"


for _job, _tables in LAW_TABLES.items():

    rule:
        name:
            f"study_laws_{_job}"
        input:
            encounters=rules.ingest_encounters.output.encounters,
            exposure=rules.ingest_encounters.output.exposure,
            family=rules.fit_family.output.family,
            maps=[
                map_of(description, "crash_map/full.npz")
                for description in ANSWERED.values()
            ],
            vehicles=ancient(ALL_FILES),
            library=modules_of("study_laws.py", members=OF_VEHICLES),
        output:
            **{table: result("laws", f"{table}.csv") for table in _tables},
            **({"law": result("laws", "answer.json")} if _job == "answer" else {}),
        log:
            log_of(f"study_laws_{_job}.log"),
        benchmark:
            benchmark_of(f"study_laws_{_job}.tsv")
        threads: ALL_WORKERS
        resources:
            mem_mb=3000,
        params:
            seed=config["seed"],
            vehicles=VEHICLES,
            vehicle_content=ALL_CONTENT,
            simulations=ALL_SIMULATIONS,
            answer=part(config["answer"], "draws", "quality_draws"),
            support=SUPPORT,
            outlier_rows=SOURCE["outlier_rows"],
            half_width=config["importance_sampling"]["beta"],
        message:
            f"Laws with dependence: {', '.join(_tables)}"
        script:
            "../scripts/study_laws.py"


rule replay_encounters:
    """Show what happens in the likeliest crashes and in the nearest records, and what each vehicle can prevent."""
    input:
        encounters=rules.ingest_encounters.output.encounters,
        law=result("laws", "answer.json"),
        map=map_of(ANSWERED["under_test"], "crash_map/full.npz"),
        vehicles=ancient(ALL_FILES),
        library=modules_of(
            "replay_encounters.py", members=OF_VEHICLES | {"laws": ["dependent"]}
        ),
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
    message:
        "Replaying the likeliest crashes and the nearest records"
    script:
        "../scripts/replay_encounters.py"
