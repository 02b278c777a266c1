"""The examples of the public names and of the guide run, and give the numbers that are known."""

import contextlib
import doctest
import importlib
import io
import pickle
import re
import subprocess
import sys
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


def blocks_of_the_guide(*, of_openturns: bool = False) -> list[str]:
    """Return the examples of the guides, either those of this package or the one of OpenTURNS."""
    text = "".join(guide.read_text(encoding="utf-8") for guide in GUIDES)
    blocks = re.findall(r"```python\n(.*?)```", text, re.DOTALL)
    return [block for block in blocks if ("openturns" in block) == of_openturns]


def test_the_guide_runs_from_top_to_bottom(tmp_path):
    blocks, names = blocks_of_the_guide(), {}
    with contextlib.chdir(tmp_path), contextlib.redirect_stdout(io.StringIO()):
        exec(blocks[0], names)
        structure = names["found"]
        for block in blocks[1:]:
            exec(block, names)
    resistance, load = names["inputs"]
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


def test_the_same_limit_state_in_openturns(capsys):
    pytest.importorskip("openturns", reason="needs the extra peers")
    (block,) = blocks_of_the_guide(of_openturns=True)
    exec(block, {})
    probability, variation, calls = map(float, capsys.readouterr().out.split())
    resistance, load = stats.norm(7, 1), stats.lognorm(0.3, scale=1.5)
    exact = quad(lambda s: resistance.cdf(s) * load.pdf(s), 0, 20, points=[1.5, 4, 7])[0]
    assert probability == pytest.approx(exact, rel=4 * variation)
    assert calls == 1200


def test_all_public_names_are_found_and_others_are_not():
    assert {"Sampler", "SeveralLaws", "estimate"} <= set(fewruns.__all__)
    assert len(fewruns.__all__) <= 15
    with pytest.raises(AttributeError, match="no attribute 'Samplers'"):
        fewruns.Samplers  # noqa: B018


def test_an_error_survives_a_process_boundary():
    error = fewruns.InputError("here", seen="one thing", expected="another", change="Change it.")
    again = pickle.loads(pickle.dumps(error))
    assert str(again) == str(error) == "here: seen one thing; expected another. Change it."
    assert isinstance(again, ValueError)


def test_importing_the_package_is_quick_because_nothing_else_is():
    code = "import fewruns, sys; sys.exit(bool({'numpy', 'numba', 'scipy'} & sys.modules.keys()))"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0
