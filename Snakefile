# From lane-change records to a crash probability: the study of Huang, Zhao, Lam and LeBlanc as a workflow.
#
#   snakemake --cores 2                                     the recorded lane changes of SPMD (data/spmd)
#   snakemake --cores 2 --configfile my_study.yaml          another study, for example with your own records
#
# Every path holds the name of the study, so studies never share a file.

from snakemake.utils import min_version

min_version("9.1")


configfile: "config/config.yaml"


include: "workflow/rules/common.smk"
include: "workflow/rules/catalogue.smk"
include: "workflow/rules/ingest.smk"
include: "workflow/rules/fit.smk"
include: "workflow/rules/accelerate.smk"
include: "workflow/rules/estimate.smk"
include: "workflow/rules/ground_truth.smk"
include: "workflow/rules/judge.smk"
include: "workflow/rules/answer.smk"
include: "workflow/rules/publish.smk"


report: "workflow/report/workflow.rst"


localrules:
    all,
    figures,
    tables,


rule figures:
    """All figures of the paper, each with its data."""
    input:
        [file for notebook in NOTEBOOKS for file in figures_of(notebook)],


rule tables:
    """All tables."""
    input:
        [file for notebook in NOTEBOOKS for file in tables_of(notebook)],


rule all:
    """Everything: figures, tables, executed notebooks and the book of them."""
    default_target: True
    input:
        rules.book.output,
        rules.figures.input,
        rules.tables.input,
