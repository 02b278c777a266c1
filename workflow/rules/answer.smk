# Answer: laws that fit where crashes happen, and one probability with its interval, for every scenario (beyond the paper).
#
# In: the encounters, the vehicles, and their crash maps where there are any. Out: the answer with its budget and rates, the
# laws and draws from them, what the answer rests on, the comparison with other vehicles, and the most probable crashes.
# The vehicle under test comes first; the others may still be mapped while one reads its answer.

EVERY = ["answer", "answer_budget", "answer_draws", "exposure", "extrapolation"]
EVERY += ["crash_places", "vehicle"]
OF_MAPS = ["answer_thresholds", "calibration", "fold_calibration", "near_misses"]
OF_FEW_RUNS = ["estimate", "runs", "crashes", "replays", "replayed_events"]
OF_LAWS_OF_CUT_INS = ["calibration", "fold_calibration"] if SUPPORT else ["joint_laws"]
WITH_INJURIES = SCENARIO in RISKS
INJURIES = ["injuries", "injuries_by_curve", "injury_budget", "injury_curves"]
INJURIES += ["risk_balance"]
OWN_MAP = (
    [f"{FOLDERS['under_test']}/crash_map/full.npz"] if "under_test" in FOLDERS else []
)
OTHERS = [
    name
    for name in VEHICLES
    if name != "under_test" and (name in FOLDERS or not SUPPORT)
]
MAPPED_OTHERS = [name for name in OTHERS if name in FOLDERS]
OWN_TABLES = ["answer_draws", "vehicle", *(["risks"] if WITH_INJURIES else [])]
JUDGED_BY = ["answer_draws", "extrapolation", *(["risks"] if WITH_INJURIES else [])]
JUDGED_BY += ["choices"] if SUPPORT and not SLOW else []
OF_WAY = (
    OF_FEW_RUNS if SLOW else OF_MAPS if OWN_MAP else ["crash_shares", "impact_speeds"]
)


rule study_answer:
    """Weight the laws, draw from them, and compute the answer for the vehicle under test.

    An interrupted job uses the stored outcomes of a slow vehicle when it is started again.
    """
    input:
        encounters=rules.ingest_encounters.output.encounters,
        exposure=rules.ingest_encounters.output.exposure,
        report=rules.inspect_records.output.report,
        family=[result("laws", "family.npz")] if SUPPORT else [],
        map=OWN_MAP,
        vehicle=ancient(local(VEHICLE_FILES)),
    output:
        **tables_of_laws(
            *EVERY, *OF_LAWS_OF_CUT_INS, *OF_WAY, *(["risks"] if WITH_INJURIES else [])
        ),
        law=result("laws", "answer.json"),
        draws=result("laws", "draws.json"),
    log:
        log_of("study_answer.log"),
    benchmark:
        benchmark_of("study_answer.tsv")
    priority: 85
    threads: WORKERS
    params:
        settings=part(config, "seed", "scenario", "vehicle"),
        slow=SLOW,
        stopping=plan_of("surrogate")["stopping"],
        batch_size=config["surrogate"]["batch_size"],
        draws=law_settings(SCENARIOS[SCENARIO], config).draws,
        events=config["answer"]["events"],
        closing_speed_max=config["answer"]["grid"]["closing_speed_max"],
        vehicle_content=VEHICLE_CONTENT,
        simulations=SIMULATIONS,
        support=SUPPORT,
        library=code_up_to("answer", *SIMULATING),
    message:
        "Weighting the laws, and computing the answer for {params.settings[vehicle][name]}"
    script:
        "../scripts/study_answer.py"


rule compare_vehicles:
    """Compare the vehicle under test with others under the same draws of the law."""
    input:
        **tables_of_laws(*OWN_TABLES),
        encounters=rules.ingest_encounters.output.encounters,
        exposure=rules.ingest_encounters.output.exposure,
        draws=rules.study_answer.output.draws,
        maps=[f"{FOLDERS[name]}/crash_map/full.npz" for name in MAPPED_OTHERS],
        vehicles=ancient(local(INPUTS.files_of(*OTHERS))),
    output:
        **tables_of_laws(
            "vehicles",
            "vehicle_draws",
            "compared",
            *(INJURIES if WITH_INJURIES else []),
        ),
        **({"parts": result("laws", "parts_of_maps.npz")} if SUPPORT else {}),
    log:
        log_of("compare_vehicles.log"),
    benchmark:
        benchmark_of("compare_vehicles.tsv")
    priority: 70
    threads: INPUTS.simulating(*OTHERS)[0]
    params:
        seed=config["seed"],
        scenario=config["scenario"],
        own=OWN_TABLES,
        vehicles={name: VEHICLES[name] for name in OTHERS},
        vehicle_content=INPUTS.content_of(*OTHERS),
        simulations=INPUTS.simulating(*OTHERS)[1],
        half_width=config["importance_sampling"]["beta"],
        support=SUPPORT,
        library=code_up_to("answer", *SIMULATING),
    message:
        "Comparing the vehicle under test with others under the same draws"
    script:
        "../scripts/compare_vehicles.py"


rule judge_criteria:
    """Judge the criteria of the configuration, for encounters of all kinds if their rate is known."""
    input:
        **tables_of_laws("vehicle_draws", *JUDGED_BY),
        all_cut_ins=rules.study_lead_motion.output.together if SUPPORT else [],
        encounters=rules.ingest_encounters.output.encounters,
        exposure=rules.ingest_encounters.output.exposure,
    output:
        **tables_of_laws("criteria", "deciding"),
    log:
        log_of("judge_criteria.log"),
    benchmark:
        benchmark_of("judge_criteria.tsv")
    params:
        scenario=SCENARIO,
        criteria=config["criteria"],
        made=[
            "vehicle_draws",
            *JUDGED_BY,
            *(["all_cut_ins"] if SUPPORT else []),
        ],
        support=SUPPORT,
        library=code_up_to("answer", *SIMULATING),
    message:
        "Judging the criteria"
    script:
        "../scripts/judge_criteria.py"


if OWN_MAP and not SLOW:
    TWICE = {name: result(TABLES[name]) for name in ROWS}

    rule compute_twice:
        """Compute the published numbers a second time, by plain importance sampling under the same draws."""
        input:
            **TWICE,
            encounters=rules.ingest_encounters.output.encounters,
            records_exposure=rules.ingest_encounters.output.exposure,
            draws=rules.study_answer.output.draws,
            model=rules.fit_models.output[MODEL],
            map=OWN_MAP,
            parts=rules.compare_vehicles.output.parts,
            vehicle_files=ancient(local(ALL_FILES)),
        output:
            table=result("second_ways.csv"),
        log:
            log_of("compute_twice.log"),
        benchmark:
            benchmark_of("compute_twice.tsv")
        threads: ALL_WORKERS
        params:
            seed=config["seed"],
            tables=list(TWICE),
            events=config["answer"]["events"],
            mapped=config["crash_map"]["events"],
            vehicles={
                name.replace("under_test", "under test"): section
                for name, section in VEHICLES.items()
            },
            vehicle_content=ALL_CONTENT,
            simulations=ALL_SIMULATIONS,
            support=SUPPORT,
            library=code_up_to("answer", *SIMULATING),
        message:
            "Computing the published numbers a second time"
        script:
            "../scripts/compute_twice.py"


if OWN_MAP:

    rule replay_encounters:
        """Simulate the most probable crashes and the most critical records, and find which crashes are preventable."""
        input:
            encounters=rules.ingest_encounters.output.encounters,
            law=rules.study_answer.output.law,
            map=f"{FOLDERS['under_test']}/crash_map/full.npz",
            vehicles=ancient(local(ALL_FILES)),
        output:
            encounters=result("happened", "encounters.csv"),
            traces=result("happened", "traces.csv"),
            preventable=result("happened", "preventable.csv"),
            prescribed=result("happened", "prescribed.csv"),
            numerical=result("happened", "numerical_error.csv"),
        log:
            log_of("replay_encounters.log"),
        benchmark:
            benchmark_of("replay_encounters.tsv")
        threads: ALL_WORKERS
        params:
            seed=config["seed"],
            tested="under test",
            vehicles={
                name.replace("under_test", "under test"): section
                for name, section in VEHICLES.items()
            },
            vehicle_content=ALL_CONTENT,
            simulations=ALL_SIMULATIONS,
            library=code_up_to("answer", *SIMULATING),
        message:
            "Simulating the most probable crashes and the most critical records"
        script:
            "../scripts/replay_encounters.py"

elif SUPPORT:

    rule replay_crashes:
        """Repeat the simulations of the most probable crashes, about a dozen, and record the states over time."""
        input:
            crashes=rules.study_answer.output.crashes,
            answer=rules.study_answer.output.answer,
            vehicle=ancient(local(VEHICLE_FILES)),
        output:
            encounters=result("happened", "encounters.csv"),
            traces=result("happened", "traces.csv"),
        log:
            log_of("replay_crashes.log"),
        benchmark:
            benchmark_of("replay_crashes.tsv")
        threads: WORKERS
        params:
            **UNDER_TEST,
            seed=config["seed"],
            library=code_up_to("answer", *SIMULATING),
        message:
            "Simulating the most probable crashes again"
        script:
            "../scripts/replay_crashes.py"
