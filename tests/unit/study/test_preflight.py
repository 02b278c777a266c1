"""Files and vehicles that a configuration names are looked up before any job."""

import copy
from pathlib import Path

import pytest
from accelerated_evaluation import InputError
from accelerated_evaluation.scenarios.cut_in import CUT_IN
from accelerated_evaluation.scenarios.left_turn import LEFT_TURN
from accelerated_evaluation.scenarios.record_table import TableRecords, named_records_of
from accelerated_evaluation.study import preflight
from accelerated_evaluation.study.configuration import load
from accelerated_evaluation.study.inputs import StudyInputs
from accelerated_evaluation.vehicles.named import NamedVehicle

ROOT = Path(__file__).resolve().parents[3]


@pytest.fixture
def config(monkeypatch):
    monkeypatch.chdir(ROOT)  # paths of a configuration begin at the project
    return copy.deepcopy(load())


def named(config):
    """Check what a configuration names."""
    preflight.require_records(named_records_of(CUT_IN, config))
    compared = preflight.compared_sections(config["compared_vehicles"])
    vehicles = {preflight.UNDER_TEST: config["vehicle"], **compared}
    preflight.require_vehicles(
        {
            label: NamedVehicle.of(section, config["simulations"], CUT_IN)
            for label, section in vehicles.items()
        }
    )


def test_the_shipped_configuration_names_what_there_is(config):
    named(config)


@pytest.mark.parametrize(
    ("section", "change", "reported"),
    [
        (
            "data",
            {"source": "table", "table": {"path": "no.csv"}},
            r"data.table.path: seen no.csv, which does not exist",
        ),
        ("vehicle", {"name": "acc_abe"}, "vehicle.name .* seen 'acc_abe'.* Did you mean acc_aeb"),
        ("vehicle", {"name": "no.py:Car"}, "vehicle.name .* no file no.py"),
        ("vehicle", {"parameters": {"aeb_jrk": 1}}, "vehicle.parameters.* Did you mean aeb_jerk"),
        (
            "compared_vehicles",
            {"rss": {"parameters": {"aeb": True}}},
            "compared_vehicles.rss, vehicle rss: seen parameter 'aeb'",
        ),
        ("compared_vehicles", {"mine": {"name": "no.py:Car"}}, "compared_vehicles.mine, .* no file no.py"),
        ("compared_vehicles", {"mine": {}}, "compared_vehicles.mine, vehicle: seen 'mine'"),
    ],
)
def test_what_is_not_there_is_told_with_its_key(config, section, change, reported):
    config[section] |= change
    with pytest.raises(InputError, match=reported):
        named(config)


def test_braces_in_a_path_are_told_before_snakemake_takes_them_for_a_wildcard():
    preflight.require_plain(["data/my records (1).csv"])
    with pytest.raises(InputError, match=r"\{2\}.csv: seen a brace"):
        preflight.require_plain(["a.csv", "data/my records {2}.csv"])


@pytest.mark.parametrize(
    ("file", "folder", "reported"),
    [
        ("results", None, "results: seen a file"),
        ("results/mine", None, "results/mine: seen a file"),
        (None, "figures/mine/tables/claims.csv", "claims.csv: seen a folder; expected a result"),
    ],
)
def test_files_and_folders_in_each_others_place_are_told(tmp_path, monkeypatch, file, folder, reported):
    monkeypatch.chdir(tmp_path)
    places = Path("results/mine"), Path("figures/mine")
    preflight.require_places(*places)
    Path("figures/mine/tables").mkdir(parents=True)
    preflight.require_places(*places)
    if file is not None:
        Path(file).parent.mkdir(exist_ok=True)
        Path(file).write_text("")
    if folder is not None:
        Path(folder).mkdir(parents=True)
    with pytest.raises(InputError, match=reported):
        preflight.require_places(*places)


@pytest.mark.parametrize("cores", [0, -1])
def test_a_study_needs_a_core(cores):
    preflight.require_cores(1)
    preflight.require_cores(None)
    with pytest.raises(InputError, match=f"--cores .* seen {cores}"):
        preflight.require_cores(cores)


def test_a_table_of_records_is_looked_up_for_every_scenario(monkeypatch):
    monkeypatch.chdir(ROOT)
    table = TableRecords(LEFT_TURN, "no.csv")
    with pytest.raises(InputError, match=r"scenario.records: seen no.csv, which does not exist; expected"):
        preflight.require_records(table)
    with pytest.raises(InputError, match=r"scenario.records: seen tests, which is no file; expected"):
        preflight.require_records(TableRecords(LEFT_TURN, "tests"))
    preflight.require_records(TableRecords(LEFT_TURN, None))


def test_vehicles_of_another_scenario_are_compared(tmp_path, monkeypatch):
    monkeypatch.chdir(ROOT)
    mine = {"name": "acc_aeb", "parameters": {"headway": 1.5}}
    given = {"scenario": {"name": "left_turn"}, "study": "mine"}
    given["compared_vehicles"] = {"later": {"name": "acc_aeb", "parameters": {"headway": 1.6}}}
    inputs = StudyInputs.checked(given, [], ROOT, cores=1, is_main_process=True)
    assert list(inputs.vehicles) == ["under_test", "later"]  # acc_aeb is the vehicle under test
    changed = StudyInputs.checked({**given, "vehicle": mine}, [], ROOT, cores=1, is_main_process=True)
    assert list(changed.vehicles) == ["under_test", "acc_aeb", "later"]
    given["compared_vehicles"] = {"rss": {}}  # a vehicle of cut-ins
    with pytest.raises(InputError, match=r"compared_vehicles.rss, vehicle: seen 'rss'"):
        StudyInputs.checked(given, [], ROOT, cores=1, is_main_process=True)
