import copy
import pickle
import sys
from functools import reduce
from operator import getitem
from pathlib import Path

import pytest
import yaml
from accelerated_evaluation.base.errors import InputError
from accelerated_evaluation.base.sections import default_of
from accelerated_evaluation.records.sources import SOURCES
from accelerated_evaluation.study import configuration
from accelerated_evaluation.study.configuration import ConfigurationError, load, tables_of_keys, validate
from accelerated_evaluation.study.schema import schema
from jsonschema import Draft202012Validator

REPOSITORY = Path(__file__).resolve().parents[3]
sys.path.append(str(REPOSITORY / "tests" / "corpus"))

from test_whole_studies import STUDIES, TINY, merged  # noqa: E402

SCHEMA = schema()


def changed(**values):
    """Return the default configuration with the values of dotted keys, written with __ for the dots."""
    config = copy.deepcopy(load())
    for key, value in values.items():
        *parents, name = key.split("__")
        reduce(getitem, parents, config)[name] = value
    return config


def violations(config):
    with pytest.raises(ConfigurationError) as error:
        validate(config)
    return list(error.value.args)


def parts_of(schema, path=()):
    """Yield each part of a schema that describes a value, with its path."""
    if "$ref" not in schema:
        yield path, schema
    for name, part in schema.get("properties", {}).items():
        yield from parts_of(part, (*path, name))
    for name, part in schema.get("$defs", {}).items():
        yield from parts_of(part, ("$defs", name))
    if "items" in schema:
        yield from parts_of(schema["items"], (*path, "items"))


# ---------------------------------------------------------------- the shipped files


@pytest.mark.parametrize("name", STUDIES)
def test_whole_studies_that_other_tests_run_have_valid_configurations(name):
    load(given=merged(TINY, STUDIES[name]))


@pytest.mark.parametrize("name", ["config", "smoke"])
def test_shipped_configurations_are_valid_studies_of_their_own(name):
    config = load([REPOSITORY / "config" / f"{name}.yaml"])
    assert config["study"] == {"config": "spmd"}.get(name, name)
    assert config["data"]["source"] == "spmd"
    assert (config["data"]["sample"] is None) == (name == "config")


def test_tables_on_the_page_of_keys_are_those_of_the_schema():
    page = configuration.PAGE_OF_KEYS.read_text()
    start, end = configuration.MARKS
    assert page.split(start)[1].split(end)[0] == tables_of_keys(), (
        "run: python -m accelerated_evaluation.study.configuration"
    )


def test_command_restores_the_tables_on_the_page_of_keys(tmp_path, monkeypatch):
    page = tmp_path / "keys.md"
    start, end = configuration.MARKS
    page.write_text(f"before\n{start}stale\n{end}after\n")
    monkeypatch.setattr(configuration, "PAGE_OF_KEYS", page)
    configuration.main()
    assert page.read_text() == f"before\n{start}{tables_of_keys()}{end}after\n"


# ---------------------------------------------------------------- the schema


def test_schema_is_valid_draft_2020_12():
    Draft202012Validator.check_schema(SCHEMA)


def is_closed(path, part):
    """Whether a part of the schema states everything: keys, limits, items and a description."""
    types = [part["type"]] if isinstance(part["type"], str) else part["type"]
    stated = [{"minItems", "items"} <= set(part)] if "array" in types else []
    if {"integer", "number"} & set(types):
        stated.append({"minimum", "exclusiveMinimum"} & set(part))
        stated.append({"maximum", "exclusiveMaximum"} & set(part))
    if "properties" in part:
        others = part.get("additionalProperties")  # of names that `consistency` checks, or none
        stated.append(others is False or (bool(others) and is_closed((*path, "others"), others)))
        stated.append(sorted(part.get("required", [])) == sorted(part["properties"]))
    elif path[-1] != "items":
        stated.append(part.get("description", "").endswith("."))
    return all(stated)


def test_schema_leaves_nothing_open():
    parts = list(parts_of(SCHEMA))
    assert len(parts) > 150
    assert [".".join(path) for path, part in parts if not is_closed(path, part)] == []


@pytest.mark.parametrize(
    "part",
    [
        {"type": "number", "minimum": 0, "description": "A number."},
        {"type": ["null", "array"], "items": {}, "description": "A list."},
        {"type": "string", "description": "No full stop"},
        {"type": "object", "properties": {"a": {}}, "required": ["a"]},
        {"type": "object", "properties": {"a": {}}, "additionalProperties": False, "required": []},
    ],
)
def test_a_part_that_leaves_something_open_is_noticed(part):
    assert not is_closed(("a",), part)


def test_the_shipped_configuration_states_the_defaults_of_all_modules():
    shipped = yaml.safe_load((REPOSITORY / "config" / "config.yaml").read_text())
    defaults = default_of(SCHEMA)
    used = defaults["data"].keys() - SOURCES.keys() | {shipped["data"]["source"]}
    assert shipped == defaults | {"data": {name: defaults["data"][name] for name in used}}


def test_the_defaults_of_all_modules_are_valid():
    validate(default_of(SCHEMA))


# ---------------------------------------------------------------- what is refused

WRONG = {
    "wrong type": ("cross_entropy__seeds", "five", 'seen "five"; expected integer >= 1 and <= 1,000'),
    "number as text": ("importance_sampling__beta", "1e-5", 'seen "1e-5"; expected number > 0 and < 1'),
    "fraction for a count": ("cross_entropy__seeds", 5.0, "seen 5.0; expected integer"),
    "true for a number": ("filters__range_max", True, "seen true; expected number"),
    "not a number": ("filters__range_max", float("nan"), "seen NaN; expected number >= 1"),
    "infinite": ("filters__lead_speed_min", float("-inf"), "seen -Infinity; expected number >= 0"),
    "impossible value": ("importance_sampling__alpha", 1.5, "seen 1.5; expected number > 0 and < 1"),
    "negative": ("seed", -1, "seen -1; expected integer >= 0"),
    "sample of nothing": ("data__sample", 0, "seen 0; expected integer >= 100 and <= 100,000,000 or null"),
    "unknown unit": ("data__table__columns__range__unit", "furlong", "expected one of m, km, ft, 1/m, 1/ft"),
    "unsafe name": ("study", "a/b", 'seen "a/b"; expected text matching'),
    "name of another folder": ("study", "vehicles", "expected a name of at most 64 characters"),
    "long name": ("study", "a" * 65, "expected a name of at most 64 characters"),
    "line break in a name": ("study", "a\n", "expected a name of at most 64 characters"),
    "short checksum": ("data__spmd__sha256", "93fc", 'seen "93fc"; expected text matching'),
    "empty path": ("data__spmd__path", "", 'seen ""; expected non-empty text'),
    "null section": ("vehicle", None, "seen null; expected mapping"),
    "number of knots": (
        "models__inverse_range__two_pieces__quantiles",
        [0.5, 0.9],
        "seen [0.5, 0.9]; expected list of 1, each number > 0 and < 1",
    ),
    "vehicle parameter": (
        "vehicle__parameters",
        {"kp": float("nan")},
        "seen NaN; expected number or true or false",
    ),
    "a method twice": (
        "methods",
        ["crude", "crude", "single", "piecewise", "heuristic", "shifted", "surrogate"],
        "expected list of at least 6, each text, none twice",
    ),
    "no text": ("vehicle__files", [1], "seen 1; expected non-empty text"),
}


@pytest.mark.parametrize(("key", "value", "message"), WRONG.values(), ids=WRONG)
def test_wrong_values_are_refused(key, value, message):
    (line,) = violations(changed(**{key: value}))
    assert line.startswith(key.replace("__", "."))
    assert message in line


def test_each_item_of_a_list_is_named():
    (line,) = violations(changed(segments__lead_speed_edges=[0, 5, 35, 200]))
    assert line == "segments.lead_speed_edges[3]: seen 200; expected number >= 0 and <= 100"


@pytest.mark.parametrize(
    ("key", "nearest"),
    [
        ("cross_entropy__sampel_size", "cross_entropy.sample_size"),
        ("filter", "filters"),
        ("cross_entropy__alpha", "importance_sampling.alpha"),  # a known key in the wrong section
        ("models__inverse_range__two_pieces__quantile", "models.inverse_range.two_pieces.quantiles"),
    ],
)
def test_unknown_keys_are_refused_with_the_nearest_known_one(key, nearest):
    (line,) = violations(changed(**{key: 1}))
    assert line.startswith(f"{key.replace('__', '.')}: seen an unknown key; expected one of ")
    assert line.endswith(f"; nearest known key: {nearest}")


def test_unknown_key_like_no_other_gets_no_suggestion():
    (line,) = violations(changed(xyzzy=1))
    assert "nearest" not in line


def test_missing_key_is_refused():
    config = changed()
    del config["models"]["inverse_ttc"]["body"]["components"]
    (line,) = violations(config)
    assert line.startswith("models.inverse_ttc.body.components: seen nothing; expected integer >= 1")


THREE = "models__inverse_range__three_pieces"
INCONSISTENT = {
    "filter": ({"filters__lead_speed_min": 35}, "lead_speed_min below lead_speed_max"),
    "edges": ({"segments__lead_speed_edges": [5, 25, 15, 35]}, "edges in increasing order"),
    "equal edges": ({"segments__lead_speed_edges": [5, 15, 15, 35]}, "edges in increasing order"),
    "edges too high": (
        {"segments__lead_speed_edges": [6, 35]},
        "edges that begin at or below lead_speed_min",
    ),
    "edges too low": ({"segments__lead_speed_edges": [5, 34]}, "end at or above lead_speed_max"),
    "quantiles": ({f"{THREE}__quantiles": [0.9, 0.5]}, "quantiles in increasing order"),
    "knots": ({f"{THREE}__values": [0.1, 0.05]}, "knots in increasing order"),
    "knots out of range": ({f"{THREE}__values": [0.01, 0.05]}, "knots above 1 / range_max"),
    "no knots": ({"models__inverse_ttc__knots__method": "values"}, "as the method is values"),
    "grid": ({f"{THREE}__profile__low": 0.999}, "low below high"),
    "events": (
        {"importance_sampling__maximum_simulations": 100, "importance_sampling__minimum_events": 101},
        "not above",
    ),
    "edges that print the same": (
        {"segments__lead_speed_edges": [5, 15, 15.0000001, 35]},
        "after rounding to six digits",
    ),
    "tried edges too high": ({"sensitivity__lead_speed_edges": [[5, 35], [6, 35]]}, "from lead_speed_min or"),
    "tried edges too low": ({"sensitivity__lead_speed_edges": [[5, 34]]}, "to lead_speed_max or above"),
    "tried edges that fall": ({"sensitivity__lead_speed_edges": [[5, 25, 15, 35]]}, "increasing order"),
    "unknown source": (
        {"data__source": "smpd"},
        "source of records: one of exid, highd, osi, spmd, spmd_raw",
    ),
    "outliers of a sample": ({"data__sample": 1000}, "no outlier rows with a sample"),
    "no table": ({"data__source": "table"}, "a path, as the source is table: CSV or Parquet file"),
    "unknown distribution": (
        {"models__inverse_ttc__tail": "bounded gamma"},
        "one of bounded exponential, bounded normal",
    ),
    "distribution that cannot be tilted": (
        {"models__inverse_range__pieces": "Pareto"},
        "can be fitted to a piece and tilted",
    ),
    "mixture that cannot be fitted": (
        {"models__inverse_ttc__body__kind": "bounded exponential"},
        "one component, or a distribution of which mixtures can be fitted: bounded normal",
    ),
    "unit of another quantity": (
        {"data__table__columns__closing__quantity": "ttc"},
        "a unit of that quantity",
    ),
    "batches": (
        {"surrogate__batch_size": 500, "surrogate__maximum_calls": 999},
        "at most half of maximum_calls",
    ),
    "a long step": ({"importance_sampling__course_step": 20_001}, "that is not above simulations"),
}


@pytest.mark.parametrize(("values", "message"), INCONSISTENT.values(), ids=INCONSISTENT)
def test_values_that_do_not_fit_together_are_refused(values, message):
    (line,) = violations(changed(**values))
    assert message in line
    assert any(key.replace("__", ".") in line for key in values)


def test_one_column_for_two_quantities_is_refused():
    (line,) = violations(changed(data__table__columns__range__name="lead_speed"))
    assert "a different column for each of the three quantities" in line


def test_all_violations_are_reported_one_a_line():
    config = changed(
        seed="x",
        filters__range_max=0,
        cross_entropy__sampel_size=1,
        segments__lead_speed_edges=[5, 35, 15, 36],
    )
    del config["study"]
    lines = violations(config)
    assert {line.split(":")[0] for line in lines} == {
        "study",
        "seed",
        "filters.range_max",
        "cross_entropy.sampel_size",
        "segments.lead_speed_edges",
    }
    assert len(lines) == 5
    with pytest.raises(ConfigurationError) as error:
        validate(config)
    assert str(error.value).splitlines()[1:] == [f"  {line}" for line in lines]


def test_conditions_on_wrong_values_are_not_reported_twice():
    (line,) = violations(changed(filters__lead_speed_max="fast"))
    assert line.startswith("filters.lead_speed_max: ")


def test_no_configuration_at_all_is_refused():
    (line,) = violations([])
    assert line.startswith("top level: seen []; expected mapping with keys such as study, ")


def test_error_survives_a_process_boundary():
    error = ConfigurationError("a: seen 1; expected 2", "b: seen 3; expected 4")
    assert str(pickle.loads(pickle.dumps(error))) == str(error)


# ---------------------------------------------------------------- loading


def test_later_files_overrule_earlier_ones_key_by_key(tmp_path):
    for name, text in {
        "a": "seed: 1\nfilters: {range_max: 50}",
        "b": "filters: {lead_speed_min: 6}\nseed: 2",
    }.items():
        (tmp_path / name).write_text(text)
    config = load([tmp_path / "a", tmp_path / "b"])
    assert config["seed"] == 2
    assert config["filters"] == {"lead_speed_min": 6, "lead_speed_max": 35, "range_max": 50}
    assert load()["filters"]["range_max"] == 75


@pytest.mark.parametrize(
    ("base", "change"),
    [
        ({"a": {"b": 1, "c": 2}}, {"a": {"b": 3}, "d": 4}),
        ({"a": {"b": 1}}, {"a": None}),
        ({"a": {"b": 1}}, {"a": {}}),
        ({"a": None}, {"a": {"b": {"c": 1}}}),
        ({"a": 1}, {"a": {"b": 2}}),
        ({"a": [1, 2]}, {"a": [3]}),
    ],
)
def test_files_are_merged_as_snakemake_merges_them(base, change):
    snakemake = pytest.importorskip("snakemake.utils")
    merged = configuration._merged(base, change)
    snakemake.update_config(base, change)
    assert merged == base


# ---------------------------------------------------------------- the texts of a user, and files


@pytest.mark.parametrize(
    "text", ["a\nb", "a\tb", "\x1b[31m", "=1+1", "+1", "-1", "@cmd", " begins with a space", "a\u2028b"]
)
@pytest.mark.parametrize("source", ["spmd", "table"])
def test_descriptions_that_a_table_cannot_hold_are_refused(text, source):
    (line,) = violations(changed(**{f"data__{source}__description": text}))
    assert line.startswith(f"data.{source}.description: seen")
    assert "one line of printable characters" in line


@pytest.mark.parametrize(
    "text", ["costs $5 | \"a\" 'b'", "<script>alert(1)</script>", "R&D: 1 = 1 - 0", "Straße 四"]
)
def test_other_descriptions_are_accepted(text):
    validate(changed(data__spmd__description=text))


@pytest.mark.parametrize(
    ("content", "reported"),
    [
        (None, "No such file"),
        (b"", "expected keys and values"),
        (b"study: a\nstudy: b\n", "key 'study' twice"),
        (b"filters:\n  range_max: 70\n  range_max: 75\n", "line 3"),
        (b"study: [a\n", "while parsing"),
        (b"study: \xff\xfe\n", "codec can't decode"),
        (b"- 1\n", "expected keys and values"),
        (b"study: " + b"[" * 3000, "recursion"),
        (b"#" * 1_000_001, "1,000,001 bytes, more than 1,000,000"),
    ],
)
def test_files_that_are_no_configuration_end_in_one_message(tmp_path, content, reported):
    path = tmp_path / "study.yaml"
    if content is not None:
        path.write_bytes(content)
    with pytest.raises(InputError, match=reported) as error:
        load([path])
    assert error.value.where.startswith(str(path))
    assert "\n" not in str(error.value)


def test_sections_of_a_file_may_share_keys(tmp_path):
    path = tmp_path / "study.yaml"
    path.write_text(
        "crash_map:\n  grid: &grid {refinement: 2}\nanswer:\n  grid: {<<: *grid, range_cells: 12}\n"
    )
    grid = load([path])["answer"]["grid"]
    assert (grid["refinement"], grid["range_cells"]) == (2, 12)


def test_a_message_shows_the_beginning_of_a_long_value():
    (line,) = violations(changed(study="a b" * 5000))
    assert len(line) < 2000
