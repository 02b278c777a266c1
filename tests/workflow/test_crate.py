"""A study packed as an RO-Crate: valid, complete, with checksums, and of nothing but what ran."""

import hashlib
import io
import json
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest

pytestmark = pytest.mark.crate

PROFILE = "provenance-run-crate-0.5"
# The terms of RO-Crate 1.1 that have another address in the version that comes with the library rocrate.
ADDRESSES = {name: f"https://bioschemas.org/{name}" for name in ("ComputationalWorkflow", "FormalParameter")}
RUN_TERMS = {"sha256": "https://w3id.org/ro/terms/workflow-run#sha256"}


def pack(project, *arguments: str) -> subprocess.CompletedProcess:
    """Run the command in the folder of a study."""
    return subprocess.run(
        [sys.executable, "-m", "accelerated_evaluation.cli", "crate", *arguments],
        cwd=project.folder,
        env=project.environment,
        capture_output=True,
        text=True,
    )


@pytest.fixture(scope="module")
def packed(finished, tmp_path_factory):
    """Return the crate of the finished study."""
    pytest.importorskip("rocrate")
    target = tmp_path_factory.mktemp("crate") / "smoke.zip"
    run = pack(finished, "smoke", "--target", str(target))
    assert run.returncode == 0, run.stderr
    return target


@pytest.fixture(scope="module")
def entities(packed):
    """Return what the crate says, by identifier."""
    with zipfile.ZipFile(packed) as archive:
        graph = json.loads(archive.read("ro-crate-metadata.json"))["@graph"]
    return {entity["@id"]: entity for entity in graph}


@pytest.fixture
def without_network(monkeypatch):
    """Answer requests for the two contexts from the library's copy, and all others with nothing."""
    requests = pytest.importorskip("requests")
    rocrate = pytest.importorskip("rocrate")
    terms = json.loads((Path(rocrate.__file__).parent / "data" / "ro-crate.jsonld").read_text())["@context"]
    contexts = {
        "https://w3id.org/ro/crate/1.1/context": terms | ADDRESSES,
        "https://w3id.org/ro/terms/workflow-run/context": RUN_TERMS,
    }

    def send(_, request, **__):
        response = requests.Response()
        response.url, response.request, response.status_code = request.url, request, 200
        response.headers["Content-Type"] = "application/ld+json"
        content = json.dumps({"@context": contexts.get(request.url, {})}).encode()
        response.raw = pytest.importorskip("urllib3").HTTPResponse(io.BytesIO(content), preload_content=False)
        return response

    monkeypatch.setattr(requests.adapters.HTTPAdapter, "send", send)


def test_the_crate_is_valid(packed, without_network, tmp_path):
    services = pytest.importorskip("rocrate_validator.services")
    models = pytest.importorskip("rocrate_validator.models")
    settings = models.ValidationSettings(
        rocrate_uri=str(packed),
        profile_identifier=PROFILE,
        requirement_severity=models.Severity.REQUIRED,
        cache_path=tmp_path / "cache",
    )
    result = services.validate(settings)
    assert result.passed(), [issue.message for issue in result.get_issues()]


def test_every_file_is_there_with_its_checksum(packed, entities):
    with zipfile.ZipFile(packed) as archive:
        inside = set(archive.namelist()) - {"ro-crate-metadata.json", "environment_installed.txt"}
        assert inside == {name for name, entity in entities.items() if "sha256" in entity}
        for name in inside:
            assert hashlib.sha256(archive.read(name)).hexdigest() == entities[name]["sha256"], name
    for name in ("data/spmd/cut_ins.parquet", "results/smoke/config.json", "environment.txt"):
        assert name in inside
    assert {
        f"figures/smoke/fig12_crash_probability.{kind}" for kind in ("pdf", "svg", "png", "csv")
    } <= inside
    assert "figures/smoke/tables/claims.csv" in inside


def test_each_job_says_what_it_read_and_made_and_by_which_code(entities):
    jobs = [entity for name, entity in entities.items() if name.startswith("#job/")]
    (fit,) = [job for job in jobs if job["name"] == "fit_models"]
    assert fit["object"] == {"@id": "results/smoke/encounters.parquet"}
    assert {"@id": "results/smoke/models/single.json"} in fit["result"]
    tool = entities[fit["instrument"]["@id"]]
    parts = {part["@id"] for part in tool["hasPart"]}
    assert {
        "workflow/scripts/fit_models.py",
        "workflow/accelerated_evaluation/laws/paper/piecewise.py",
    } <= parts
    assert not any("publishing" in part for part in parts)
    assert len(tool["softwareVersion"]) == 64
    searches = [job for job in jobs if job["name"].startswith("search_proposals")]
    assert sorted(job["name"] for job in searches)[0] == "search_proposals heuristic"
    assert fit["startTime"] <= fit["endTime"] <= min(job["startTime"] for job in searches)


def test_code_that_did_not_make_the_study_is_refused(finished, tmp_path):
    project = finished.copied(tmp_path)
    module = project.folder / "workflow/accelerated_evaluation/laws/paper/piecewise.py"
    module.write_text(module.read_text() + "\n# edited\n")
    run = pack(project, "smoke")
    assert run.returncode == 2
    assert "accelerated_evaluation/laws: seen code with the digest" in run.stderr
    assert "Run the study again" in run.stderr
    assert not (project.folder / "results/smoke.crate.zip").exists()


def test_a_study_that_did_not_run_is_refused(project):
    run = pack(project, "smoke")
    assert run.returncode == 2
    assert "results/smoke/config.json: seen no such file" in run.stderr
