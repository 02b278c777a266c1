"""Compute exact probabilities, severity, and the variance under every f* from the crash maps and the laws."""

from accelerated_evaluation.base.files import read_json, write_csv
from accelerated_evaluation.crash_map.exact_variance import exact_tables
from accelerated_evaluation.crash_map.maps import read_crash_map
from accelerated_evaluation.laws.files import read_law
from accelerated_evaluation.laws.paper.models import PAPER_LAWS
from accelerated_evaluation.methods.cross_entropy.search import read_proposals
from accelerated_evaluation.records.segments import read_encounters
from accelerated_evaluation.study.jobs import job

if __name__ == "__main__":
    with job(snakemake.log[0]):
        files, params = snakemake.input, snakemake.params
        encounters = read_encounters(files.encounters)
        labels = zip(params.methods, params.seeds, strict=True)
        tables = exact_tables(
            {name: read_crash_map(files[name]) for name in ("quarter", "half", "full")},
            {name: read_law(files[name], encounters) for name in PAPER_LAWS},
            params.variant,
            {
                label: read_proposals(path).factors
                for label, path in zip(labels, files.proposals, strict=True)
            },
            len(encounters),
            read_json(files.exposure)["kilometres"],
        )
        for name, path in snakemake.output.items():
            write_csv(path, tables[name])
