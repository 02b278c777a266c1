"""Draw a figure that a module of the user registers, from the results of the study."""

from accelerated_evaluation.publishing.published import FIGURES, show
from accelerated_evaluation.publishing.study import Study
from accelerated_evaluation.study.jobs import job

if __name__ == "__main__":
    with job(snakemake.log[0]):
        show(Study(**snakemake.params.study), FIGURES[snakemake.params.figure])
