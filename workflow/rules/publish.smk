# Publish: one notebook a section of the paper, each making its figures and tables from finished results.
#
# In: everything under results/<study>/. Out: figures/<study>/*.{pdf,svg,png,csv}, figures/<study>/tables/*, the
# executed notebooks and their HTML. The table below says what each notebook reads and makes.

ENCOUNTERS = {"encounters": rules.ingest_encounters.output.encounters}
FITTED = ENCOUNTERS | {
    "models": [result("models", f"{model}.json") for model in MODELS]
}
SEARCHED = FITTED | {
    "trace": rules.collect_traces.output.trace,
    "proposals": expand(
        rules.search_proposals.output.proposals, method=METHODS, seed=SEEDS
    ),
}
ESTIMATED = SEARCHED | dict(rules.collect_estimates.output.items())
EXACT = {
    name: path
    for rule in ("compute_exact", "study_sensitivity", "bootstrap_uncertainty")
    for name, path in getattr(rules, rule).output.items()
}

NOTEBOOKS = {
    "01_introduction": {"reads": SEARCHED, "figures": ["fig01_concept"]},
    "02_single_parametric_models": {
        "reads": FITTED
        | {
            "account": rules.ingest_encounters.output.account,
            "description": list(rules.describe_encounters.output),
            "candidates": rules.collect_candidates.output.candidates,
        },
        "figures": ["fig02_data"],
        "tables": ["encounters_account", "candidates"],
    },
    "03_piecewise_mixture_models": {
        "reads": FITTED | {"candidates": rules.collect_candidates.output.candidates}
    },
    "04_accelerated_evaluation": {"reads": FITTED},
    "05_cross_entropy": {"reads": SEARCHED, "figures": ["fig03_cross_entropy_flow"]},
    "06_simulation_analysis": {
        "reads": ESTIMATED,
        "figures": [
            "fig04_inverse_range_fit",
            "fig05_inverse_ttc_fit",
            "fig06_inverse_range_comparison",
            "fig07_inverse_ttc_comparison",
            "fig08_thresholds",
            "fig09_inverse_range_parameters",
            "fig10_inverse_ttc_parameters",
            "fig11_inverse_ttc_density",
            "fig12_crash_probability",
            "fig13_relative_half_width",
        ],
        "tables": ["table1_sample_size"],
    },
    "07_conclusions": {
        "reads": ESTIMATED | {"exact": rules.compute_exact.output.exact},
        "tables": ["table2_computation", "estimates", "claims"],
    },
    "08_ground_truth": {
        "reads": ESTIMATED
        | EXACT
        | {"crude": list(rules.run_crude_monte_carlo.output)},
        "figures": [
            "fig14_estimates_against_truth",
            "fig15_sensitivity",
            "fig16_uncertainty",
            "fig17_severity",
        ],
        "tables": [
            "exact",
            "convergence",
            "sensitivity",
            "uncertainty",
            "severity",
            "crude",
        ],
    },
    "09_honest_intervals": {
        "reads": FITTED
        | {
            "coverage": rules.collect_coverage.output.coverage,
            "exact": rules.compute_exact.output.exact,
        },
        "figures": ["fig18_coverage"],
        "tables": ["coverage"],
    },
    "10_fewest_simulations": {
        "reads": ESTIMATED
        | {"exact": rules.compute_exact.output.exact}
        | dict(rules.sample_by_surrogate.output.items()),
        "figures": ["fig19_surrogate_runs", "fig20_methods"],
        "tables": ["surrogate"],
    },
}


rule record_configuration:
    """Write the resolved configuration beside the results."""
    input:
        library=modules_of("record_configuration.py"),
    output:
        config=result("config.json"),
    log:
        log_of("record_configuration.log"),
    benchmark:
        benchmark_of("record_configuration.tsv")
    threads: 1
    resources:
        mem_mb=500,
    params:
        config=config,
    message:
        "Recording the configuration"
    script:
        "../scripts/record_configuration.py"


for _notebook in NOTEBOOKS:

    rule:
        name:
            f"run_{_notebook}"
        input:
            **NOTEBOOKS[_notebook]["reads"],
            notebook=f"notebooks/{_notebook}.ipynb",
            config=rules.record_configuration.output.config,
            library=modules_of("run_notebook.py", f"notebooks/{_notebook}.ipynb"),
        output:
            figures=made(_notebook, "figures"),
            tables=made(_notebook, "tables"),
            executed=result("notebooks", f"{_notebook}.ipynb"),
            html=in_report(
                result("notebooks", f"{_notebook}.html"), "Notebooks", _notebook
            ),
        log:
            log_of("notebooks", f"{_notebook}.log"),
        benchmark:
            benchmark_of("notebooks", f"{_notebook}.tsv")
        threads: 1
        resources:
            mem_mb=1500,
        params:
            parameters={
                "study": STUDY,
                "results": str(RESULTS),
                "figures": str(FIGURES),
            },
        message:
            f"Running the notebook {_notebook}"
        script:
            "../scripts/run_notebook.py"
