"""Write the article of a study as PDF."""

from pathlib import Path

from accelerated_evaluation.publishing.article.pdf import Sources, write_article
from accelerated_evaluation.publishing.study import Study
from accelerated_evaluation.study.jobs import job

if __name__ == "__main__":
    with job(snakemake.log[0]):
        files = snakemake.input
        sources = Sources(
            text=Path(files.text[0]).parent,
            benchmarks=Path(files.benchmarks[0]).parent,
            captions=Path(files.captions[0]).parent,
        )
        study = Study(**snakemake.params.study)
        write_article(study, sources, Path(snakemake.output[0]))
