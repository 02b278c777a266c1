# Scenario: methods that need no strata, and published verdicts, for another scenario than the cut-in.
#
# In: the law with the largest weight, the vehicle, published verdicts of the scenario. Out: the estimates of every method,
# and the agreement with the verdicts.

from accelerated_evaluation.answer.ways.compared_methods import METHODS_OF_SCORES
from accelerated_evaluation.base.extensions import added

VERDICTS = INPUTS.verdicts
# The methods of the project that need no strata, and those of the user that the configuration names.
COMPARED = [
    *METHODS_OF_SCORES,
    *(name for name in config["methods"] if name in added(METHODS.package)),
]
SECTIONS = sorted(
    {key for name in COMPARED for key in METHODS[name].sections + METHODS[name].plan}
)


rule compare_scenario_methods:
    """Estimate the crash probability under the law with the largest weight by every method that uses normal scores."""
    input:
        law=result("laws", "answer.json"),
        vehicle=ancient(local(VEHICLE_FILES)),
    output:
        estimates=result("scenario", "estimates.csv"),
    log:
        log_of("compare_scenario_methods.log"),
    benchmark:
        benchmark_of("compare_scenario_methods.tsv")
    threads: WORKERS
    params:
        **UNDER_TEST,
        study=STUDY,
        seed=config["seed"],
        scenario=SCENARIO,
        event=config["scenario"]["event"],
        methods=COMPARED,
        settings=part(config, *SECTIONS),
        library=code_up_to(
            "answer", *SIMULATING, *(f"methods/{name}" for name in COMPARED)
        ),
    message:
        "Comparing the methods on the scenario {params.scenario}"
    script:
        "../scripts/compare_scenario_methods.py"


rule compare_verdicts:
    """Compare the vehicle with the published verdicts of the scenario; an empty table if there are none."""
    input:
        verdicts=ancient(local(VERDICTS)),
        vehicle=ancient(local(VEHICLE_FILES)),
    output:
        agreement=result("scenario", "agreement.csv"),
    log:
        log_of("compare_verdicts.log"),
    benchmark:
        benchmark_of("compare_verdicts.tsv")
    threads: WORKERS
    params:
        **UNDER_TEST,
        scenario=SCENARIO,
        library=code_up_to("answer", *SIMULATING),
    message:
        "Comparing the vehicle with published verdicts"
    script:
        "../scripts/compare_verdicts.py"
