"""The examples of the public names and of the guide run, and give the numbers that are known."""

import contextlib
import doctest
import importlib
import io
import pickle
import re
from pathlib import Path

import fewruns
import numpy as np
import pytest
from scipy import stats
from scipy.integrate import quad

FOLDER = Path(__file__).resolve().parents[1]
GUIDES = [FOLDER / "README.md", FOLDER / "sampler_reference.md"]
MODULES = sorted(set(fewruns._HOME.values()))


@pytest.mark.parametrize("module", MODULES)
def test_the_examples_of_a_module_run(module):
    tried = doctest.testmod(importlib.import_module(f"fewruns.{module}"))
    assert tried.failed == 0


def test_every_public_function_and_class_has_an_example():
    for name in fewruns.__all__:
        assert ">>>" in getattr(fewruns, name).__doc__, name


OTHERS = ("openturns", "gest_api")


def blocks_of_the_guide(other: str = "") -> list[str]:
    """Return the examples of the guides, either those of this package alone or the one with another."""
    text = "".join(guide.read_text(encoding="utf-8") for guide in GUIDES)
    blocks = re.findall(r"```python\n(.*?)```", text, re.DOTALL)
    return [block for block in blocks if other == next((name for name in OTHERS if name in block), "")]


def test_the_guide_runs_from_top_to_bottom(tmp_path):
    blocks, names = blocks_of_the_guide(), {}
    with contextlib.chdir(tmp_path), contextlib.redirect_stdout(io.StringIO()):
        exec(blocks[0], names)
        structure = names["found"]
        for block in blocks[1:]:
            exec(block, names)
    runs, (resistance, load) = structure.tables["runs"], names["inputs"]
    np.testing.assert_allclose(runs.x_1 - runs.x_2, runs.score)
    exact = quad(lambda s: resistance.cdf(s) * load.pdf(s), 0, 20, points=[1.5, 4, 7])[0]
    assert structure.converged
    assert 0.5 < structure.probability / exact < 2
    assert not 0.5 < structure.probability / resistance.cdf(load.mean()) < 2  # with a load that is not random

    def given(z):  # probability of failure for a normal score of the resistance
        return stats.norm.pdf(z) * stats.norm.sf((np.log((7 + z) / 1.5) / 0.3 + 0.6 * z) / 0.8)

    assert names["joint"].converged
    assert 0.5 < names["joint"].probability / quad(given, -6, 6)[0] < 2
    sums = stats.norm.sf((6 - names["means"]) / np.sqrt(2))
    assert np.abs(np.log(names["found"].probabilities / sums)).max() < 0.7
    assert names["sampler"].has_converged(names["goal"])


def test_the_generator_of_gest_api_suggests_as_many_points_as_wanted_and_ends():
    pytest.importorskip("gest_api", reason="needs the extra gest")
    (block,) = blocks_of_the_guide("gest_api")
    names = {"np": np, "stats": stats}
    with contextlib.redirect_stdout(io.StringIO()):
        exec(block, names)
    found, laws, vocs = names["farm"].estimate(), names["laws"], names["vocs"]
    assert found.converged
    assert 0.5 < found.probability / 6.2e-6 < 2
    farm = names["EventGenerator"](vocs, laws, np.random.default_rng(2), deterministic=True)
    first, second = farm.suggest(30), farm.suggest(30)  # the second without any result
    assert len({point["_id"] for point in first + second}) == 60
    late = [{**point, "margin": np.nan if point is second[0] else 1.0} for point in second]
    farm.ingest(late[::-1])
    assert farm.sampler.simulations == 0  # earlier runs are pending
    farm.ingest([{**point, "margin": -1.0} for point in first])
    progress = farm.sampler.progress
    assert progress.happened.sum() == 30
    assert (len(progress.z), len(progress.failed)) == (59, 1)
    for unknown in (second[:1], [{"resistance": 7.0, "load": 1.0}]):
        with pytest.raises(ValueError, match="those of the requested runs"):
            farm.ingest([{**point, "margin": 1.0} for point in unknown])
    two = vocs.model_copy(update={"constraints": {**vocs.constraints, "other": vocs.constraints["margin"]}})
    with pytest.raises(ValueError, match="one constraint"):
        names["EventGenerator"](two, laws, np.random.default_rng(2))


def test_all_public_names_are_found_and_others_are_not():
    assert {"Sampler", "SeveralLaws", "estimate"} <= set(fewruns.__all__)
    with pytest.raises(AttributeError, match="no attribute 'Samplers'"):
        fewruns.Samplers  # noqa: B018


def test_an_error_survives_a_process_boundary():
    error = fewruns.InputError("here", seen="one thing", expected="another", change="Change it.")
    again = pickle.loads(pickle.dumps(error))
    assert str(again) == str(error) == "here: seen one thing; expected another. Change it."
    assert isinstance(again, ValueError)
