"""Bad input ends in one message, a status that is not 0, and no output left behind.

Each test here is one way by which a message reaches the user through Snakemake: while it reads the
configuration, before the first job, or from a job. The messages are tested with the library, in tests/unit:
test_configuration, test_preflight and test_encounters.
"""

import pandas as pd
import yaml


def study(project, **data):
    """Write a configuration whose data differ from the default, and run its ingest step."""
    config = project.folder / "bad.yaml"
    config.write_text(yaml.safe_dump({"study": "bad", **data}))
    return project.run("results/bad/encounters.parquet", config="bad.yaml")


def message(run) -> str:
    output = run.stdout + run.stderr
    assert run.returncode != 0
    assert "Traceback" not in output, output[-3000:]
    return output


def table(project, name="events.csv", **columns):
    """Write a user's table and return the part of the configuration that names it."""
    good = {"lead_speed": [10.0] * 60, "range": [20.0] * 60, "closing_speed": [1.0] * 60}
    pd.DataFrame({**good, **columns}).to_csv(project.folder / name, index=False)
    return {"data": {"source": "table", "table": {"path": name}}}


def test_a_job_that_fails_while_it_writes_runs_again_although_its_files_are_kept(project):
    """Snakemake issue 3808: with --keep-incomplete, files of a failed job count as complete."""
    varied = {name: [low + 0.1 * i for i in range(60)] for name, low in [("range", 20), ("closing_speed", 1)]}
    (project.folder / "good.yaml").write_text(yaml.safe_dump({"study": "bad", **table(project, **varied)}))
    target, last = "results/bad/encounters.parquet", project.folder / "results/bad/exposure.json"
    last.mkdir(parents=True)
    (last / "in_the_way").touch()
    message(project.run(target, "--keep-incomplete", config="good.yaml"))
    (last / "in_the_way").unlink()
    last.rmdir()
    again = project.run(target, config="good.yaml")
    assert again.returncode == 0, again.stdout + again.stderr
    assert len(pd.read_parquet(project.folder / target)) == 60
    assert last.is_file()


def test_when_no_row_is_left_the_account_is_kept_beside_the_log(project):
    output = message(study(project, **table(project, closing_speed=[-1.0] * 60)))
    assert "none of which passed the filters (60 by closing" in output
    assert not [path for path in project.folder.glob("results/bad/*") if path.suffix in (".parquet", ".csv")]
    account = pd.read_csv(project.folder / "results/bad/logs/ingest_encounters_account.csv")
    assert account.set_index("step").loc["closing", "rows_dropped"] == 60


def test_a_configuration_that_cannot_be_read_is_named(project):
    (project.folder / "bad.yaml").write_text("study: bad\nseed: 1\nseed: 2\n")
    last = message(project.run("--dry-run", config="bad.yaml")).strip().splitlines()[-1]
    assert last.startswith("error: ")
    assert "bad.yaml: seen" in last
    assert "'seed' twice in line 3" in last


def test_a_study_without_the_figures_of_the_article_says_so(project):
    run = project.run("article", "--dry-run", config="config/pedestrian.yaml")
    assert run.returncode != 0
    assert "has no article, because it does not publish fig" in run.stdout + run.stderr
    assert not list(project.folder.glob("results/*/article*"))
