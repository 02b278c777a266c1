"""Make the book, a web site with the executed notebooks and the guides; write the provenance of the study."""

from pathlib import Path

from accelerated_evaluation.base.files import write_json
from accelerated_evaluation.publishing.book.site import Parts, build_book, known_to_pages
from accelerated_evaluation.publishing.provenance import provenance_of
from accelerated_evaluation.publishing.study import Study
from accelerated_evaluation.study.jobs import job

if __name__ == "__main__":
    with job(snakemake.log[0]):
        study = Study(**snakemake.params.study)
        parts = Parts(
            study,
            notebooks=[Path(path) for path in snakemake.input.notebooks],
            tables=snakemake.params.tables,
            guides=[Path(path) for path in snakemake.input.guides],
            pages=Path(snakemake.input.pages[0]).parent,
            explorer=next(map(Path, snakemake.input.explorer), None),
            added=snakemake.params.added,
        )
        build_book(parts, Path(snakemake.output.site), known_to_pages(study, snakemake.params.records))
        published = map(Path, snakemake.input.published)
        write_json(snakemake.output.provenance, provenance_of(study, published))
