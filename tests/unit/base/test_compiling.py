"""Compiled code of an earlier version of a file is no obstacle to the present one."""

import os
import subprocess
import sys

import pytest

MODULE = """
from typing import NamedTuple
from accelerated_evaluation.base.compiling import cached_njit

class {name}(NamedTuple):
    mass: float

@cached_njit()
def doubled(car):
    return {factor} * car.mass

print(doubled({name}(2.0)))
"""


@pytest.mark.parametrize("name", ["Car", "Vehicle"])
def test_a_new_version_of_a_compiled_file_replaces_the_old_one(tmp_path, name):
    """Also if a class in it has a new name, with which numba alone cannot read what it compiled before."""
    module, printed = tmp_path / "module_of_user.py", []
    for place, content in enumerate(
        (MODULE.format(name="Car", factor=2), MODULE.format(name=name, factor=3))
    ):
        module.write_text(content)
        # Files of the same second must differ in age, as an update and what was compiled before it do.
        os.utime(module, (1_000_000_000, 1_000_000_000) if not place else None)
        done = subprocess.run(
            [sys.executable, "-c", "import module_of_user"],
            cwd=tmp_path, capture_output=True, text=True, check=False,
        )  # fmt: skip
        printed.append(done.stdout.strip() or done.stderr)
        assert list((tmp_path / "__pycache__").glob("*.nbi"))
    assert printed == ["4.0", "6.0"]
