"""YAML as its authors mean it: numbers with powers, dates, octal numbers; and limits of parameters."""

import json
from datetime import date

import pytest
from accelerated_evaluation import InputError, cli
from accelerated_evaluation.base import strict_yaml
from accelerated_evaluation.scenarios import SCENARIOS
from accelerated_evaluation.scenarios.parameters import parameter_names
from accelerated_evaluation.study.configuration import (
    ConfigurationError,
    load,
    read_again,
    read_yaml,
    require_plain_numbers,
)
from accelerated_evaluation.vehicles.loading import load_vehicle
from snakemake.cli import parse_config
from snakemake.common.configfile import load_configfile


def written(folder, text):
    path = folder / "study.yaml"
    path.write_text(text)
    return path


@pytest.mark.parametrize(
    ("text", "read"),
    [
        ("seed: 017", "017, which YAML reads as 15"),
        ("seed: -0o17", None),
        ("seed: 1:30", "1:30, which YAML reads as 90"),
        ("seed: 1_0:30", "1_0:30, which YAML reads as 630"),
        ("vehicle: {parameters: {headway: 1:30.5}}", "1:30.5, which YAML reads as 90.5"),
        ("seed: 1_0", "1_0, which YAML reads as 10"),
        ("importance_sampling: {beta: 0.1_5}", "0.1_5, which YAML reads as 0.15"),
        ("importance_sampling: {beta: 1_0e-2}", None),
        ("data: {table: {outlier_rows: [010]}}", "010, which YAML reads as 8"),
    ],
)
def test_numbers_that_yaml_reads_as_others_are_refused(tmp_path, text, read):
    path = written(tmp_path, text)
    if read is None:  # a text, which the schema refuses
        with pytest.raises(ConfigurationError, match=r"(seed|beta): seen"):
            load([path])
        return
    with pytest.raises(InputError, match=rf"study\.yaml: seen {read}; .* in \".*study\.yaml\"|{read}"):
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


@pytest.mark.parametrize("text", ["1_0", "017", "08", "1_0.5"])
def test_numbers_of_the_command_line_that_could_be_others_are_refused(text):
    with pytest.raises(InputError, match=rf"--config seed: seen {text}; expected a number without"):
        require_plain_numbers(["snakemake", "--cores", "1", "--config", "study=mine", f"seed={text}"])
    with pytest.raises(InputError, match=f"--config seed: seen {text}"):
        require_plain_numbers(["snakemake", f"--config=seed={text}"])


def test_plain_numbers_and_other_texts_of_the_command_line_are_accepted():
    plain = ["seed=10", "study=a_1", "answer={draws: 1_0}", "study=", "criteria=1e-7 per hour"]
    require_plain_numbers(["snakemake", "--cores=01", "--config", "mine=01", *plain])


@pytest.mark.parametrize("number", ["1e308", "1.0e+308", "1e9", "500", ".inf", ".nan", "-1e308"])
@pytest.mark.parametrize("scenario", ["cut_in", "left_turn", "pedestrian"])
def test_parameters_have_limits_in_both_notations(scenario, number, tmp_path, capsys):
    columns = SCENARIOS[scenario].names
    row = ["1" if each == "pedestrian_speed_mps" else "9" for each in columns]
    (tmp_path / "in.csv").write_text(",".join(columns) + "\n" + ",".join(row) + "\n")
    source, target = str(tmp_path / "in.csv"), str(tmp_path / "out.csv")
    command = ["simulate", source, target, "--scenario", scenario, "--parameter", f"headway={number}"]
    assert cli.main(command) == 2
    assert "vehicle parameter headway: seen " in capsys.readouterr().err
    assert not (tmp_path / "out.csv").exists()
    assert cli.main([*command[:-1], "headway=1.5e0"]) == 0


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


def test_json_is_read_as_before(tmp_path):
    path = written(tmp_path, json.dumps({"study": "a", "importance_sampling": {"beta": 0.2}}))
    assert load([path])["importance_sampling"]["beta"] == 0.2


@pytest.mark.parametrize(
    "text", ["a: &x {b: *x}", "a: &x [1, *x]", "a: &x {b: {c: [*x]}}", "data: &x {source: table, table: *x}"]
)
def test_a_configuration_that_holds_itself_is_refused(text, tmp_path):
    (tmp_path / "self.yaml").write_text(text)
    with pytest.raises(InputError, match="a part that holds itself by an alias"):
        read_yaml(tmp_path / "self.yaml")


def test_an_alias_that_is_used_twice_is_no_loop(tmp_path):
    (tmp_path / "twice.yaml").write_text("a: &x {b: 1}\nc: *x\nd: [*x, *x]")
    assert read_yaml(tmp_path / "twice.yaml")["d"] == [{"b": 1}, {"b": 1}]
