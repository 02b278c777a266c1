"""The files by which others find and cite the project say the same as pyproject.toml."""

import json
import re
import tomllib
from pathlib import Path

import pytest
import yaml

ROOT = Path(__file__).resolve().parents[3]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
CITATION = yaml.safe_load((ROOT / "CITATION.cff").read_text())
ZENODO = json.loads((ROOT / ".zenodo.json").read_text())
CODEMETA = json.loads((ROOT / "codemeta.json").read_text())


@pytest.mark.parametrize(
    "found", [CITATION, ZENODO, CODEMETA], ids=["CITATION.cff", ".zenodo.json", "codemeta.json"]
)
def test_name_version_licence_and_description_agree(found):
    assert found.get("title", found.get("name")) == PROJECT["name"]
    assert found["version"] == PROJECT["version"]
    assert found["license"].rsplit("/", 1)[-1] == PROJECT["license"]
    assert found.get("abstract", found.get("description")) == PROJECT["description"]
    assert found["keywords"] == CITATION["keywords"]


def test_authors_and_date_agree():
    (author,) = [author["name"] for author in CITATION["authors"]]
    assert [creator["name"] for creator in ZENODO["creators"]] == [author]
    assert [creator["name"] for creator in CODEMETA["author"]] == [author]
    assert CODEMETA["datePublished"] == CITATION["date-released"]
    version, date = re.findall(r"^## (\d+\.\d+\.\d+) - (\S+)$", (ROOT / "CHANGELOG.md").read_text(), re.M)[0]
    assert (version, date) == (CITATION["version"], CITATION["date-released"])


def test_the_tests_run_on_every_python_that_is_supported():
    workflow = yaml.safe_load((ROOT / ".github/workflows/tests.yml").read_text())
    versions = workflow["jobs"]["tests"]["strategy"]["matrix"]["python-version"]
    assert f">={versions[0]}" == PROJECT["requires-python"]
    assert versions == [f"3.{minor}" for minor in range(11, 14)]
