"""Law files: what is read back is equal to what was written, and nothing else is read."""

import json
import math
from dataclasses import replace
from functools import cache

import numpy as np
import pandas as pd
import pytest
from accelerated_evaluation import LAWS, Box, DrawnLaws, InputError, read_law, write_law
from accelerated_evaluation.laws import distributions as dist
from accelerated_evaluation.laws.files import signed
from accelerated_evaluation.laws.lead_speeds import WithLeadSpeeds, with_lead_speeds
from accelerated_evaluation.laws.mixed import MixedLaws
from accelerated_evaluation.laws.paper.models import IndependentLaw
from accelerated_evaluation.records.segments import complete

NORMALS = dist.BoundedNormal(0.1 / 3, 0.0, 0.166), dist.BoundedNormal(0.07, 0.0, 0.166, -1e-17)
BODY = dist.Mixture((0.1, 0.9), NORMALS)
PIECEWISE = dist.PiecewiseMixture((0.95, 0.05), (BODY, dist.BoundedExponential(21.084581450393657, 0.166)))
RAW = {"lead_speed": [20.0, 7.0, 6.0, 30.0], "range": [9.0, 8.0, 7.0, 6.0], "closing_speed": [1.0, 2, 3, 4]}
ENCOUNTERS = complete(pd.DataFrame(RAW)).assign(segment=["15-25", "5-15", "5-15", "25-35"])
LAW = IndependentLaw(
    "made up for a test: Größe",
    {"5-15": 75783, "15-25": 3},
    dist.Pareto(1.7320507600110688, 1 / 75),
    {"5-15": PIECEWISE, "15-25": dist.BoundedExponential(-3.0, 0.0, 2.0)},
    {"5-15": dist.Empirical([6.0, 7.0]), "15-25": dist.Empirical([20.0])},
    closing_speed_max=23.49,
)
BOX = Box(("speed_mps", "distance_m"), (-3.0, 0.0), (4.0, 50.0))
CUT_IN_BOX = Box(("range", "closing_speed"), (0.0, 0.0), (60.0, 40.0))
SPEEDS, OTHERS = dist.Empirical([20.0, 7.0, 6.0, 30.0]), dist.Empirical([20.0, 7.0, 6.0, 31.0])
JOINT = ("gaussian_copula", "independent_variables", "kernel", "truncated_normals")


@cache
def joint_law(kind, box=BOX):
    generator = np.random.default_rng(1)
    return LAWS[kind].fit(generator.uniform(box.lower, box.upper, (50, 2)), box, generator)


@cache
def drawn_laws(names):
    """Return one draw of a joint law for each name."""
    laws = [joint_law("independent_variables", CUT_IN_BOX) for _ in names]
    return DrawnLaws.of(laws, names, np.random.default_rng(3))


def draws_of(names, lead_speeds):
    """Return draws that have the lead speeds of cut-ins too."""
    return with_lead_speeds(drawn_laws(names), lead_speeds)


def strict(path):
    """Return the content of a file of standard JSON, which has neither NaN nor infinity."""

    def refuse(constant):
        raise AssertionError(f"{constant} is no JSON")

    return json.loads(path.read_text(encoding="utf-8"), parse_constant=refuse)


def read_again(law, folder, records=ENCOUNTERS):
    """Write a law, read it, and check that it is written equally again; return it and the content."""
    first, second = folder / "first.json", folder / "second.json"
    write_law(first, law, records)
    read = read_law(first, records)
    write_law(second, read, records)
    assert first.read_bytes() == second.read_bytes()
    assert type(read) is type(law)
    assert (read.description, read.box) == (law.description, law.box)
    return read, strict(first)


def test_every_kind_of_law_has_a_test_of_its_file():
    others = {"mean", "limited"}  # in the tests of these laws
    assert {*LAWS} == {"independent", "with_lead_speeds", "draws", "mixed", *JOINT} | others


@pytest.mark.parametrize(
    "distribution",
    [
        dist.BoundedExponential(1 / 3, 0.1),
        dist.BoundedExponential(-1e-300, 0.5, 1.0),
        dist.BoundedNormal(1e-9, 0.1, math.inf, 0.3),
        dist.Pareto(math.pi, 1 / 75),
        BODY,
        PIECEWISE,
        PIECEWISE.accelerated((-3.7, 20.1), (0.01, 0.99)),
    ],
)
def test_every_distribution_comes_back_equal(tmp_path, distribution):
    inverse_ttc = LAW.inverse_ttc | {"15-25": distribution}
    back, _ = read_again(replace(LAW, inverse_range=distribution, inverse_ttc=inverse_ttc), tmp_path)
    for same in (back.inverse_range, back.inverse_ttc["15-25"]):
        assert same == distribution
        assert type(same) is type(distribution)


@pytest.mark.parametrize("cap", [23.49, math.inf])
def test_a_law_of_cut_ins_comes_back_equal(tmp_path, cap):
    written = replace(LAW, closing_speed_max=cap)
    law, content = read_again(written, tmp_path)
    assert law == written
    assert law.digest == written.digest
    assert law != replace(written, closing_speed_max=22.0)
    assert law.segments == tuple(law.strata) == ("5-15", "15-25")
    assert law.shares == {"5-15": 75783 / 75786, "15-25": 3 / 75786}
    assert law.n_parameters == 1 + 5 + 1
    assert law.closing_speed_max == cap
    assert content["version"] == 2
    assert content["variables"][2] == {
        "name": "closing_speed",
        "lower": 0,
        "upper": cap if cap < math.inf else None,
    }


@pytest.mark.parametrize("kind", JOINT)
def test_a_joint_law_comes_back_equal_and_needs_no_table(tmp_path, kind):
    law = joint_law(kind)
    read, content = read_again(law, tmp_path, None)
    assert read.content() == law.content()
    assert read.digest == law.digest
    x = np.random.default_rng(2).uniform(BOX.lower, BOX.upper, (20, 2))
    np.testing.assert_array_equal(read.log_density(x), law.log_density(x))
    assert "records" not in content


@pytest.mark.parametrize(
    "make",
    [
        lambda speeds: WithLeadSpeeds(joint_law("kernel", CUT_IN_BOX), speeds),
        lambda speeds: draws_of(("one", "two"), speeds),
        lambda speeds: draws_of(("one", "two"), speeds) + draws_of(("three",), speeds),
        lambda speeds: MixedLaws([draws_of((name,), speeds).proposal for name in "ab"], np.array([0.3, 0.7])),
    ],
)
def test_laws_and_draws_with_lead_speeds_come_back_equal_with_their_table(tmp_path, make):
    law = make(SPEEDS)
    read, _ = read_again(law, tmp_path)
    assert read.digest == law.digest != make(OTHERS).digest
    x = law.draw(30, np.random.default_rng(2))
    assert np.isin(x[:, 0], SPEEDS.values).all()
    np.testing.assert_array_equal(read.log_density(x), law.log_density(x))
    assert np.isneginf(law.log_density(np.array([[20.0, 9.0, 40.0]])))  # the cap of other laws
    for table in (None, ENCOUNTERS[1:]):
        with pytest.raises(InputError, match="the encounter table of this law: seen"):
            read_law(tmp_path / "first.json", table)


def test_draws_of_a_scenario_come_back_equal_and_need_no_table(tmp_path):
    drawn = drawn_laws(("one", "two"))
    read, content = read_again(drawn, tmp_path, None)
    assert read.names == ("one", "two")
    assert "records" not in content
    x = drawn.draw(30, np.random.default_rng(2))
    np.testing.assert_array_equal(read.log_densities(x), drawn.log_densities(x))


def test_lead_speeds_are_those_of_the_table_and_of_no_other(tmp_path):
    path = tmp_path / "law.json"
    write_law(path, LAW, ENCOUNTERS)
    assert "7.0" not in path.read_text(encoding="utf-8")
    law = read_law(path, ENCOUNTERS)
    speeds = {name: [speeds.lower, speeds.upper] for name, speeds in law.lead_speeds.items()}
    assert speeds == {"5-15": [6, 7], "15-25": [20, 20]}
    others = {
        "seen no table; expected the table of the law": None,
        "seen another table: 3 rows": ENCOUNTERS[1:],
        "seen another table: 4 rows .*expected the table to which the law was fitted: 4 rows": (
            ENCOUNTERS.assign(lead_speed=[20.0, 7.0, 6.0, 30.1])
        ),
        "seen another table: 4 rows with": ENCOUNTERS.assign(segment="5-15"),
    }
    for message, table in others.items():
        with pytest.raises(InputError, match=message):
            read_law(path, table)
    write_law(path, LAW, ENCOUNTERS[1:])
    with pytest.raises(InputError, match=r"law\.json: seen .*no rows in segment 15-25"):
        read_law(path, ENCOUNTERS[1:])


def changed(value, *path):
    """Return the content of a law file with one place changed, or left out if the value is ``...``."""

    def change(content):
        *above, last = path
        place = content
        for key in above:
            place = place[key]
        if value is ...:
            del place[last]
        else:
            place[last] = value
        return json.dumps(signed(content))

    return change


PIECES = ("inverse_ttc", "distributions", "5-15")
PIECE = (*PIECES, "components", 1)
CAP = ("variables", 2, "upper")
DAMAGES = [
    *(changed(value, "version") for value in (0, 1, 3, ...)),
    changed("something else", "format"),
    *(changed(value, "kind") for value in ("mean", "truncated_normals", "unknown", ["independent"], ...)),
    *(changed(value, "description") for value in (7, ...)),
    *(changed(value, "variables") for value in ([], 23.49, ...)),
    *(changed(value, *CAP) for value in ("fast", 0.0, -1.0, float("nan"), ...)),
    changed("speed", "variables", 2, "name"),
    changed(1.0, "variables", 2, "lower"),
    changed(80.0, "variables", 1, "upper"),
    *(changed(value, "records") for value in ({}, ...)),
    changed(..., "inverse_range"),
    changed("Weibull", "inverse_range", "distribution", "kind"),
    *(changed(value, *PIECE, "kind") for value in (["bounded", "exponential"], ...)),
    *(changed(value, *PIECE, "rate") for value in (..., "fast", None, -1.0)),
    changed(0.2, *PIECE, "lower"),
    changed(1.0, *PIECE, "colour"),
    *(changed(value, *PIECES, "weights") for value in ([0.5, 0.6], [float("nan"), 1.0])),
    changed([1, 2], "inverse_ttc", "distributions"),
    changed(..., "inverse_ttc", "distributions", "15-25"),
    *(changed(value, "counts", "15-25") for value in (..., 0, "many")),
    changed({}, "counts"),
    lambda content: json.dumps(content)[:-40],
    *(lambda content, text=text: text for text in ("", "[]", "\x00\x01")),
]


@pytest.mark.parametrize("change", DAMAGES)
def test_what_is_not_a_whole_law_is_refused(tmp_path, change):
    path = tmp_path / "law.json"
    write_law(path, LAW, ENCOUNTERS)
    path.write_text(change(strict(path)))
    with pytest.raises(InputError, match=r"law\.json.*: seen .*; expected "):
        read_law(path, ENCOUNTERS)


def numbers_in(part):
    """Yield each list or mapping of a content with the key of a number in it."""
    for key, value in part.items() if isinstance(part, dict) else enumerate(part):
        if isinstance(value, dict | list):
            yield from numbers_in(value)
        elif isinstance(value, int | float):
            yield part, key


def test_a_file_in_which_any_number_was_changed_is_refused(tmp_path):
    path = tmp_path / "law.json"
    write_law(path, LAW, ENCOUNTERS)
    content, tried = strict(path), 0
    for part, key in numbers_in(content):
        whole = part[key]
        for wrong in (-1, 1e308, 1e-300, whole + 0.5, 2 * whole + 1):
            part[key] = wrong
            path.write_text(json.dumps(content))
            with pytest.raises(InputError, match=r"law\.json: seen .*(checksum|law', )"):
                read_law(path, ENCOUNTERS)
            tried += 1
        part[key] = whole
    assert tried > 100
    path.write_text(json.dumps(content, indent=7, sort_keys=True))  # another layout is the same file
    assert read_law(path, ENCOUNTERS) == LAW


def test_a_joint_law_without_a_density_is_refused(tmp_path):
    path = tmp_path / "law.json"
    write_law(path, joint_law("truncated_normals"))
    path.write_text(changed(-1.0, "components", 0, "covariance", 0, 0)(strict(path)))
    with pytest.raises(InputError, match="expected a complete law file"):
        read_law(path)


def test_a_missing_file_and_other_bytes_are_refused(tmp_path):
    with pytest.raises(InputError, match="no such file"):
        read_law(tmp_path / "none.json", ENCOUNTERS)
    (tmp_path / "law.json").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(InputError, match="complete law file"):
        read_law(tmp_path / "law.json", ENCOUNTERS)


@pytest.mark.parametrize(
    "parts",
    [
        {"counts": {"5-15": 3}},
        {"counts": {}},
        {"counts": {"5-15": 3, "15-25": 0}},
        {"counts": {"5-15": 3, "15-25": 2.5}},
        {"inverse_ttc": {"5-15": PIECEWISE}},
        {"lead_speeds": {"5-15": dist.Empirical([6.0])}},
    ],
)
def test_parts_of_other_segments_are_refused(parts):
    with pytest.raises(ValueError, match=r"same segments|positive whole numbers"):
        replace(LAW, **parts)
