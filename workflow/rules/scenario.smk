# Scenario: the crash probability in a scenario other than the cut-in, from its records, and a comparison of methods.
#
# In: the records with their report and published verdicts of the scenario, the vehicle. Out: the account of the records, the laws with
# their scores, the answer with its budget and draws, the law with the largest weight, the estimates of every method,
# the agreement with the verdicts.

VERDICTS = INPUTS.verdicts


rule study_scenario:
    """Account for the records, fit and score the laws, and compute the answer with its uncertainty."""
    input:
        records=ancient(RECORDS),
        report=rules.inspect_records.output.report,
        vehicle=ancient(VEHICLE_FILES),
    output:
        encounters=result("scenario", "encounters.csv"),
        account=result("scenario", "records.csv"),
        laws=result("scenario", "laws.csv"),
        answer=result("scenario", "answer.csv"),
        budget=result("scenario", "budget.csv"),
        draws=result("scenario", "draws.csv"),
        extrapolation=result("scenario", "extrapolation.csv"),
        crash_shares=result("scenario", "crash_shares.csv"),
        law=result("scenario", "law.json"),
    log:
        log_of("study_scenario.log"),
    benchmark:
        benchmark_of("study_scenario.tsv")
    threads: WORKERS
    resources:
        mem_mb=2000,
    params:
        seed=config["seed"],
        content=content_of_records,
        scenario=config["scenario"],
        vehicle=config["vehicle"],
        vehicle_content=VEHICLE_CONTENT,
        simulations=SIMULATIONS,
        library=code_up_to("answer"),
    message:
        "Weighting the laws of the scenario {params.scenario[name]}, and drawing the answer"
    script:
        "../scripts/study_scenario.py"


rule compare_scenario_methods:
    """Estimate the crash probability under the law with the largest weight by every method that uses normal scores."""
    input:
        law=rules.study_scenario.output.law,
        vehicle=ancient(VEHICLE_FILES),
    output:
        estimates=result("scenario", "estimates.csv"),
        runs=result("scenario", "runs.csv"),
    log:
        log_of("compare_scenario_methods.log"),
    benchmark:
        benchmark_of("compare_scenario_methods.tsv")
    threads: WORKERS
    resources:
        mem_mb=1000,
    params:
        config=part(
            config, "study", "seed", "scenario", "importance_sampling", "surrogate"
        ),
        vehicle=config["vehicle"],
        vehicle_content=VEHICLE_CONTENT,
        simulations=SIMULATIONS,
        library=code_up_to("answer"),
    message:
        "Comparing the methods on the scenario {params.config[scenario][name]}"
    script:
        "../scripts/compare_scenario_methods.py"


rule compare_verdicts:
    """Compare the vehicle with the published verdicts of the scenario; an empty table if there are none."""
    input:
        verdicts=ancient(VERDICTS),
        vehicle=ancient(VEHICLE_FILES),
    output:
        agreement=result("scenario", "agreement.csv"),
    log:
        log_of("compare_verdicts.log"),
    benchmark:
        benchmark_of("compare_verdicts.tsv")
    threads: WORKERS
    resources:
        mem_mb=1000,
    params:
        scenario=SCENARIO,
        vehicle=config["vehicle"],
        vehicle_content=VEHICLE_CONTENT,
        simulations=SIMULATIONS,
        library=code_up_to("answer"),
    message:
        "Comparing the vehicle with published verdicts"
    script:
        "../scripts/compare_verdicts.py"
