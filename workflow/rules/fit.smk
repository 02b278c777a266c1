# Fit: lane-change models and their comparison (paper, sections II, III and VI.A).
#
# In: encounters.parquet. Out: a model file for each of the paper's laws, the table of candidate
# families with log-likelihood, AIC, BIC and rank, and the family of laws with dependence (beyond the paper).

from accelerated_evaluation.laws.paper.models import PAPER_LAWS, PIECEWISE


rule fit_models:
    """Fit the piecewise mixtures, with knots as configured, and the single parametric model."""
    input:
        encounters=rules.ingest_encounters.output.encounters,
    output:
        **{model: result("models", f"{model}.json") for model in PAPER_LAWS},
    log:
        log_of("fit_models.log"),
    benchmark:
        benchmark_of("fit_models.tsv")
    params:
        models={
            "inverse_range": part(
                config["models"]["inverse_range"],
                "pieces",
                *PIECEWISE,
            ),
            "inverse_ttc": config["models"]["inverse_ttc"],
        },
        description=lambda _: INPUTS.records.description,
        closing_speed_max=config["models"]["closing_speed_max"],
        range_max=config["filters"]["range_max"],
        library=code_up_to("laws", "laws/distributions"),
    message:
        "Fitting the lane-change models"
    script:
        "../scripts/fit_models.py"


rule fit_family:
    """Fit the laws with dependence, score them on held-out records, and store laws and scores for other jobs."""
    input:
        encounters=rules.ingest_encounters.output.encounters,
    output:
        family=result("laws", "family.npz"),
    log:
        log_of("fit_family.log"),
    benchmark:
        benchmark_of("fit_family.tsv")
    priority: 90
    params:
        support=SUPPORT,
        library=code_up_to("answer", "laws/smooth"),
    message:
        "Fitting the laws with dependence"
    script:
        "../scripts/fit_family.py"


# The variables and segments in which the candidates are compared.
COMPARED = [("inverse_range", segment) for segment in ["all", *SEGMENTS]]
COMPARED += [("inverse_ttc", segment) for segment in SEGMENTS]


rule fit_candidates:
    """Fit 18 common families and the piecewise models to each variable in each segment."""
    input:
        encounters=rules.ingest_encounters.output.encounters,
        models=[rules.fit_models.output[name] for name in PIECEWISE],
    output:
        candidates=result("candidates.csv"),
    log:
        log_of("fit_candidates.log"),
    benchmark:
        benchmark_of("fit_candidates.tsv")
    params:
        compared=COMPARED,
        library=code_up_to("laws", "laws/distributions"),
    message:
        "Comparing candidate families of R^-1 and TTC^-1"
    script:
        "../scripts/fit_candidates.py"
