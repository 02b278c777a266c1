# World: comparison of the predictions with crashes that were counted on roads (beyond the paper).
#
# In: crash probabilities and rates of the vehicles; the laws; counted crashes from data/crash_counts of this project.
# Out: predicted and counted crash rates in one table; predicted crashes and near-crashes of human drivers; one crash rate
# of all cut-ins, with what is not known about lead motion.


rule count_crashes:
    """Compare the predicted crash rates of the vehicles with counted ones."""
    input:
        vehicles=result("laws", "vehicles.csv"),
        exposure=result("laws", "exposure.csv"),
        events=of_project("data/crash_counts/hundred_car_events.tsv.gz"),
        published=of_project("data/crash_counts/published_rates.csv"),
    output:
        counted=result("counted_crashes.csv"),
    log:
        log_of("count_crashes.log"),
    benchmark:
        benchmark_of("count_crashes.tsv")
    params:
        library=code_up_to("answer", *SIMULATING),
    message:
        "Comparing predicted crash rates with counted ones"
    script:
        "../scripts/count_crashes.py"


rule predict_humans:
    """Predict the crashes and near-crashes of human drivers, and compare them with counted ones."""
    input:
        encounters=rules.ingest_encounters.output.encounters,
        family=rules.fit_family.output.family,
        exposure=result("laws", "exposure.csv"),
        draws=result("laws", "draws.json"),
        own=result("laws", "answer_draws.csv"),
        events=of_project("data/crash_counts/hundred_car_events.tsv.gz"),
    output:
        predicted=result("human_predictions.csv"),
    log:
        log_of("predict_humans.log"),
    benchmark:
        benchmark_of("predict_humans.tsv")
    priority: 60
    params:
        seed=config["seed"],
        grid=answered("under_test")["limits"] | config["answer"]["grid"],
        draws=config["answer"]["draws"],
        support=SUPPORT,
        library=code_up_to("answer", *SIMULATING),
    message:
        "Predicting crashes and near-crashes of human drivers"
    script:
        "../scripts/predict_humans.py"


rule study_lead_motion:
    """Estimate crash probabilities with a lead vehicle that changes its speed, and one crash rate of all cut-ins."""
    input:
        records=ancient(local(RECORDS)),  # encounters.parquet lacks the cut-ins whose gap opens
        encounters=rules.ingest_encounters.output.encounters,
        family=rules.fit_family.output.family,
        maps=[f"{folder}/crash_map/full.npz" for folder in FOLDERS.values()],
        vehicles=ancient(local(INPUTS.files_of(*MAPPED_VEHICLES))),
        profiles=of_project("data/europe/lead_motion.parquet"),
        exposure=rules.ingest_encounters.output.exposure,
        draws=result("laws", "vehicle_draws.csv"),
    output:
        moving=result("lead_motion.csv"),
        europe=result("lead_motion_europe.csv"),
        together=result("all_cut_ins.csv"),
    log:
        log_of("study_lead_motion.log"),
    benchmark:
        benchmark_of("study_lead_motion.tsv")
    params:
        seed=config["seed"],
        content=content_of_records,
        data=config["data"],
        filters=config["filters"],
        vehicles={name: VEHICLES[name] for name in MAPPED_VEHICLES},
        vehicle_content=INPUTS.content_of(*MAPPED_VEHICLES),
        simulations=INPUTS.simulating(*MAPPED_VEHICLES)[1],
        draws=config["answer"]["draws"],
        support=SUPPORT,
        library=code_up_to("answer", *SIMULATING),
    message:
        "Estimating crashes with a lead vehicle that changes its speed"
    script:
        "../scripts/study_lead_motion.py"
