"""YAML as its authors mean it: numbers with powers, dates, octal numbers; and limits of parameters."""

from datetime import date

import pytest
from accelerated_evaluation import InputError
from accelerated_evaluation.base import strict_yaml
from accelerated_evaluation.scenarios import SCENARIOS
from accelerated_evaluation.scenarios.parameters import parameter_names
from accelerated_evaluation.study.configuration import ConfigurationError, load, read_again, read_yaml
from accelerated_evaluation.vehicles.loading import load_vehicle
from snakemake.cli import parse_config
from snakemake.common.configfile import load_configfile


def written(folder, text):
    path = folder / "study.yaml"
    path.write_text(text)
    return path


@pytest.mark.parametrize(
    "text",
    [
        "seed: 017",
        "seed: -0o17",
        "seed: 1:30",
        "seed: 1_0:30",
        "seed: 1_0",
        "importance_sampling: {beta: 0.1_5}",
        "importance_sampling: {beta: 1_0e-2}",
    ],
)
def test_numbers_that_yaml_reads_as_others_are_texts(tmp_path, text):
    path = written(tmp_path, text)
    assert read_again(load_configfile(path), [path]) == read_yaml(path)
    with pytest.raises(ConfigurationError, match=r"(seed|beta): seen \".*\"; expected"):
        load([path])


@pytest.mark.parametrize("name", ["2024-01-01", "'2024-01-01'", "'017'", "a1e5"])
def test_a_study_may_have_the_name_of_a_date(tmp_path, name):
    path = written(tmp_path, f"study: {name}\nseed: 0\n")
    assert load([path])["study"] == name.strip("'")
    by_snakemake = load_configfile(path)
    assert read_again(by_snakemake, [path]) == read_yaml(path)
    assert read_again({"study": date(2024, 1, 1)}, [])["study"] == "2024-01-01"  # of --config or a module


@pytest.mark.parametrize("name", ["2024", "1e5", "on"])
def test_a_name_that_is_no_text_needs_quotation_marks(tmp_path, name):
    with pytest.raises(ConfigurationError, match=r"study: seen .*; expected text .* in quotation marks"):
        load([written(tmp_path, f"study: {name}")])


def test_a_number_with_a_power_is_a_number_whoever_reads_it(tmp_path):
    text = "importance_sampling: {beta: 2e-1}\nseed: '1e3'\n"
    text += "vehicle: {parameters: {aeb_jerk: 1.6E1, kp: -3e+1}}\n"
    path = written(tmp_path, text)
    by_snakemake = load_configfile(path)
    assert by_snakemake["importance_sampling"]["beta"] == "2e-1"
    given = {**by_snakemake, "study": "1e5"}  # a text of the command line stays one
    config = read_again(given, [path])
    assert config["importance_sampling"]["beta"] == 0.2
    assert config["vehicle"]["parameters"] == {"aeb_jerk": 16.0, "kp": -30.0}
    assert config["seed"] == "1e3"  # in quotation marks
    assert config["study"] == "1e5"
    assert strict_yaml.load("[1e9, .5e-3, 1_0E2, 1e, e5, 0x1f]") == [1e9, 5e-4, "1_0E2", "1e", "e5", 31]


@pytest.mark.parametrize(
    ("given", "meant"),
    [
        (
            "answer={draws: 50, events: {impact_speed: [5, 1e1]}}",
            {"draws": 50, "events": {"impact_speed": [5, 10]}},
        ),
        ("simulations={slow: true, executor: processes}", {"slow": True, "executor": "processes"}),
        ("filters={range_max: 60.5, lead_speed_min: auto}", {"range_max": 60.5, "lead_speed_min": "auto"}),
        ("data={sample: null, table: {path: 7}}", {"sample": None, "table": {"path": "7"}}),
        ("vehicle={name: rss, parameters: {kp: 2}}", {"name": "rss", "parameters": {"kp": 2}}),
        ("answer={draws: 1_0}", {"draws": "1_0"}),  # which the schema refuses
    ],
)
def test_values_of_the_command_line_have_the_types_of_their_keys(given, meant):
    config = read_again(parse_config([given]), [])
    assert list(config.values()) == [meant]


def test_every_number_of_every_built_in_vehicle_has_limits():
    checked = 0
    for scenario in SCENARIOS.values():
        for name, kind in scenario.vehicles.items():
            if name in ("fmu", "command"):
                continue
            for parameter in parameter_names(kind):
                default = getattr(load_vehicle(name, scenario), parameter)
                if isinstance(default, float | None) or (type(default) is int and parameter != "seed"):
                    for wrong in (1e308, -1e308, 1e5 * (default or 1.0), "1"):
                        with pytest.raises(InputError, match=f"vehicle parameter {parameter}"):
                            load_vehicle(name, scenario, **{parameter: wrong})
                        checked += 1
    assert checked > 300


@pytest.mark.parametrize(
    "text", ["a: &x {b: *x}", "a: &x [1, *x]", "a: &x {b: {c: [*x]}}", "data: &x {source: table, table: *x}"]
)
def test_a_configuration_that_holds_itself_is_refused(text, tmp_path):
    (tmp_path / "self.yaml").write_text(text)
    with pytest.raises(InputError, match="Circular reference"):
        read_yaml(tmp_path / "self.yaml")
