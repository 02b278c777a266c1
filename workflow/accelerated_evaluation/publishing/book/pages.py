"""Contents of the first and the last page of the book: the answer, and the provenance."""

import platform
from collections.abc import Iterable
from importlib.metadata import version
from pathlib import Path
from typing import Any

import yaml

from accelerated_evaluation.base.files import PROJECT, file_digest
from accelerated_evaluation.publishing.archive.provenance import commit_of
from accelerated_evaluation.publishing.study import Study
from accelerated_evaluation.publishing.tables.exact import contradictions
from accelerated_evaluation.publishing.tables.extrapolation import rests_in_words
from accelerated_evaluation.publishing.tables.paper_numbers import PAPER_PROBABILITY
from accelerated_evaluation.scenarios.cut_in import CUT_IN

# Packages whose versions the last page lists: those behind numbers, figures and pages. environment.txt pins
# all.
PACKAGES = ("numpy", "scipy", "pandas", "pyarrow", "numba", "matplotlib")
PACKAGES += ("snakemake", "papermill", "jinja2", "sphinx", "myst-nb", "sphinx-book-theme")


def known_to_pages(study: Study, records: Iterable[str]) -> dict[str, Any]:
    """Return the values that are inserted into the templates of the first and the last page, by name.

    The last page lists the SHA-256 checksums of the records.
    """
    common = {
        "vehicle": study.config["vehicle"],
        "commit": commit_of(PROJECT),
        "checksums": {str(path): _checksum(Path(path)) for path in records},
        "versions": {"Python": platform.python_version()} | {name: version(name) for name in PACKAGES},
        "configuration": yaml.safe_dump(study.config, allow_unicode=True, sort_keys=False).strip(),
    }
    if study.scenario is not CUT_IN:
        answer = study.answer
        rests = rests_in_words(study.extrapolation, by_speed=False)
        return common | {"crash": answer.iloc[0], "answers": answer.to_dict("records"), "rests": rests}
    common["crash"] = study.answer.set_index("event").loc["crash"]
    common["rests"] = rests_in_words(study.extrapolation)
    return common | (
        {"compared": study.compared} if study.config["simulations"]["slow"] else _of_the_paper(study)
    )


def _of_the_paper(study: Study) -> dict[str, Any]:
    """Return the values that need results of the paper's methods and of crude Monte Carlo."""
    return {
        "paper_probability": PAPER_PROBABILITY,
        "contradicted": contradictions(study.truth, study.crude),
    }


def _checksum(path: Path) -> str:
    """Return the SHA-256 of a data file, or "no such file", since it may have been deleted meanwhile."""
    return file_digest(path) if path.is_file() else "no such file"
