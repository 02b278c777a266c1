# All vehicles of the study under laws of the study: exact probabilities, and what the sampler makes of them.
#
#   snakemake --snakefile benchmarks/samplers/vehicles.smk --cores 2 [--config seeds=40]
#
# A job for the crash map of each vehicle, one for all estimates under a law, and one for exported sets.

import os
import sys

sys.path[:0] = [workflow.basedir, os.path.join(workflow.basedir, "..")]

from library import modules_up_to
from vehicles import LAWS, vehicles


include: "../../workflow/rules/this_run.smk"


HERE = "benchmarks/samplers"
RAW = "results/benchmarks/vehicles"
SCRIPT = f"{HERE}/vehicles.py"
SEEDS = int(config.get("seeds", 40))
CODE = [
    *(f"{HERE}/{name}.py" for name in ("vehicles", "run", "house", "methods")),
    *modules_up_to("study"),
    "config/config.yaml",
]


rule compare:
    """The table, and what it is made from, because the tracked table alone would make a fresh clone look finished."""
    input:
        "benchmarks/results/vehicles.csv",
        "benchmarks/results/exported.csv",
        expand(f"{RAW}/{{law}}.csv", law=LAWS),


rule map:
    """Map the crashes of a vehicle."""
    input:
        CODE,
    output:
        f"{RAW}/maps/{{vehicle}}.npz",
    message:
        "Crash map of {wildcards.vehicle}"
    shell:
        "python {SCRIPT} map {wildcards.vehicle} --output {output}"


rule run:
    """Compute and estimate the crash probabilities of all vehicles under a law."""
    input:
        CODE,
        records="data/spmd/cut_ins.parquet",
        maps=expand(rules.map.output, vehicle=vehicles()),
    output:
        f"{RAW}/{{law}}.csv",
    log:
        f"{RAW}/logs/{{law}}.log",
    params:
        seeds=SEEDS,
    message:
        "All vehicles under the law {wildcards.law}"
    shell:
        "python {SCRIPT} run {wildcards.law} --maps {RAW}/maps --seeds {params.seeds} --output {output} > {log} 2>&1"


rule table:
    """Sum up all runs."""
    input:
        f"{HERE}/summarise.py",
        script=SCRIPT,
        runs=expand(rules.run.output, law=LAWS),
    output:
        "benchmarks/results/vehicles.csv",
    message:
        "Summing up"
    shell:
        "python {input.script} table {input.runs} --output {output}"


rule sets:
    """Estimate the probabilities from exported sets of scenarios."""
    input:
        CODE,
        records="data/spmd/cut_ins.parquet",
        maps=expand(rules.map.output, vehicle=vehicles()),
    output:
        "benchmarks/results/exported.csv",
    message:
        "Exported sets"
    shell:
        "python {SCRIPT} sets {input.maps} --output {output}"
