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
    assert with_results(changed, "| old |\n") == with_results(text, "| old |\n")


@pytest.mark.skipif(not CLAIMS.exists(), reason="the tables of the real events are not in this copy")
def test_readme_tells_the_shares_of_the_uncertainty():
    shares = pd.read_csv(CLAIMS.parent / "uncertainty.csv").set_index("source")["variance_share"]
    text = " ".join(README.read_text(encoding="utf-8").split())
    assert shares["sampling"] < 0.01
    assert f"sampling has under 1 % of it, finite data {100 * shares['data']:.0f} %" in text
