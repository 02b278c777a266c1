"""The README shows the published numbers, and nothing else."""

import pandas as pd
import pytest
from accelerated_evaluation.publishing.readme import CLAIMS, README, results_table, with_results


@pytest.mark.skipif(not CLAIMS.exists(), reason="the tables of the real events are not in this copy")
def test_readme_shows_the_published_results():
    text = README.read_text(encoding="utf-8")
    assert with_results(text, results_table(pd.read_csv(CLAIMS))) == text


def test_the_table_is_put_between_its_marks():
    text = README.read_text(encoding="utf-8")
    changed = with_results(text, "| new |\n")
    assert "| new |\n" in changed
    assert with_results(changed, results_table(pd.read_csv(CLAIMS))) == text if CLAIMS.exists() else True
