"""What the first and the last page of the book tell: the answer, the claims, and what the book was made from."""

import hashlib
import platform
import subprocess
from importlib.metadata import version
from pathlib import Path
from typing import Any

import pandas as pd
import yaml

from accelerated_evaluation.publishing.paper_numbers import PAPER_PROBABILITY
from accelerated_evaluation.publishing.study import Study
from accelerated_evaluation.publishing.tables import readable, to_markdown

# Those that the numbers, the figures and the pages are made with; environment.txt pins all others too.
PACKAGES = ("numpy", "scipy", "pandas", "pyarrow", "numba", "matplotlib")
PACKAGES += ("snakemake", "papermill", "jinja2", "sphinx", "myst-nb", "sphinx-book-theme")
CLAIM_COLUMNS = {
    "claim": "number",
    "source": "where in the paper",
    "paper": "paper",
    "ours": "ours",
    "ours_low": "from",
    "ours_high": "to",
    "verdict": "verdict",
}


def known_to_pages(study: Study) -> dict[str, Any]:
    """Return the names that the templates of the first and the last page use."""
    claims = pd.read_csv(study.figures / "tables" / "claims.csv")
    claims = claims[list(CLAIM_COLUMNS)].rename(columns=CLAIM_COLUMNS).map(readable)
    data = study.config["data"]
    records = Path(data[data["source"]]["path"])
    return {
        "crash": study.answer.set_index("event").loc["crash"],
        "vehicle": study.config["vehicle"],
        "paper_probability": PAPER_PROBABILITY,
        "claims": to_markdown(claims),
        "made_from": {
            "commit": _commit(),
            "records": str(records),
            "their SHA-256": hashlib.sha256(records.read_bytes()).hexdigest(),
        },
        "versions": {"Python": platform.python_version()} | {name: version(name) for name in PACKAGES},
        "configuration": yaml.safe_dump(study.config, allow_unicode=True, sort_keys=False).strip(),
    }


def _commit() -> str:
    """Return the commit of the repository in the working folder, and whether its files differ from it."""
    command = ["git", "describe", "--always", "--abbrev=40", "--dirty=, with changes"]
    try:
        found = subprocess.run(command, capture_output=True, text=True, check=True)
    except (OSError, subprocess.CalledProcessError):
        return "not known, as the folder is no git repository"
    return found.stdout.strip()
