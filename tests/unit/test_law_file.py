"""The law file: what is read back is equal to what was written, and nothing else is read."""

import json
import math
from dataclasses import replace

import pandas as pd
import pytest
from accelerated_evaluation.base.errors import InputError
from accelerated_evaluation.distributions import (
    BoundedExponential,
    BoundedNormal,
    Empirical,
    Mixture,
    Pareto,
    PiecewiseMixture,
)
from accelerated_evaluation.laws.files import read_law, write_law
from accelerated_evaluation.laws.paper.independent import IndependentLaw

BODY = Mixture((0.1, 0.9), (BoundedNormal(0.1 / 3, 0.0, 0.166), BoundedNormal(0.07, 0.0, 0.166, -1e-17)))
PIECEWISE = PiecewiseMixture((0.95, 0.05), (BODY, BoundedExponential(21.084581450393657, 0.166)))
ENCOUNTERS = pd.DataFrame(
    {"segment": ["15-25", "5-15", "5-15", "25-35"], "lead_speed": [20.0, 7.0, 6.0, 30.0]}
)
LAW = IndependentLaw(
    "made up for a test: Größe",
    {"5-15": 75783, "15-25": 3},
    Pareto(1.7320507600110688, 1 / 75),
    {"5-15": PIECEWISE, "15-25": BoundedExponential(-3.0, 0.0, 2.0)},
    {"5-15": Empirical([6.0, 7.0]), "15-25": Empirical([20.0])},
    closing_speed_max=23.49,
)


def test_a_file_whose_counts_are_called_events_is_read(tmp_path):
    write_law(tmp_path / "law.json", LAW)
    content = json.loads((tmp_path / "law.json").read_text(encoding="utf-8"))
    content["events"] = content.pop("counts")
    (tmp_path / "law.json").write_text(json.dumps(content), encoding="utf-8")
    assert read_law(tmp_path / "law.json", ENCOUNTERS) == LAW


@pytest.mark.parametrize(
    "law",
    [
        BoundedExponential(1 / 3, 0.1),
        BoundedExponential(-1e-300, 0.5, 1.0),
        BoundedNormal(1e-9, 0.1, math.inf, 0.3),
        Pareto(math.pi, 1 / 75),
        BODY,
        PIECEWISE,
        PIECEWISE.accelerated((-3.7, 20.1), (0.01, 0.99)),
    ],
)
def test_every_kind_comes_back_equal(tmp_path, law):
    written = replace(LAW, inverse_range=law, inverse_ttc=LAW.inverse_ttc | {"15-25": law})
    write_law(tmp_path / "law.json", written)

    def refuse(constant):
        raise AssertionError(f"{constant} is no JSON")

    json.loads((tmp_path / "law.json").read_text(encoding="utf-8"), parse_constant=refuse)
    back = read_law(tmp_path / "law.json", ENCOUNTERS)
    for same in (back.inverse_range, back.inverse_ttc["15-25"]):
        assert same == law
        assert type(same) is type(law)


@pytest.mark.parametrize("cap", [23.49, math.inf])
def test_a_law_comes_back_equal_and_is_written_equally(tmp_path, cap):
    first, second = tmp_path / "first.json", tmp_path / "second.json"
    written = replace(LAW, closing_speed_max=cap)
    write_law(first, written)
    law = read_law(first, ENCOUNTERS)
    assert law == written
    assert law != replace(written, closing_speed_max=22.0)
    assert law.segments == tuple(law.strata) == ("5-15", "15-25")
    assert law.shares == {"5-15": 75783 / 75786, "15-25": 3 / 75786}
    assert law.n_parameters == 1 + 5 + 1
    assert law.closing_speed_max == cap
    write_law(second, law)
    assert first.read_bytes() == second.read_bytes()


def test_lead_speeds_are_those_of_the_encounters(tmp_path):
    write_law(tmp_path / "law.json", LAW)
    assert "lead_speed" not in (tmp_path / "law.json").read_text(encoding="utf-8")
    law = read_law(tmp_path / "law.json", ENCOUNTERS)
    assert {name: [speeds.lower, speeds.upper] for name, speeds in law.lead_speeds.items()} == {
        "5-15": [6, 7],
        "15-25": [20, 20],
    }
    with pytest.raises(InputError, match=r"law\.json: seen .*no rows in segment 15-25"):
        read_law(tmp_path / "law.json", ENCOUNTERS[1:])


def changed(path, value):
    """Return the content of the law's file with one place changed, or left out if the value is ``...``."""

    def change(content):
        *above, last = path
        place = content
        for key in above:
            place = place[key]
        if value is ...:
            del place[last]
        else:
            place[last] = value
        return json.dumps(content)

    return change


PIECE = ("inverse_ttc", "distributions", "5-15", "components", 1)


@pytest.mark.parametrize(
    "change",
    [
        changed(("version",), 1),
        changed(("version",), 3),
        changed(("version",), ...),
        changed(("format",), "something else"),
        changed(("kind",), "dependent"),
        changed(("kind",), ...),
        changed(("kind",), ["independent"]),
        changed(("description",), ...),
        changed(("closing_speed_max",), ...),
        changed(("closing_speed_max",), 23.49),
        changed(("closing_speed_max", "value"), "fast"),
        changed(("inverse_range",), ...),
        changed(("inverse_range", "distribution", "kind"), "Weibull"),
        changed((*PIECE, "kind"), ["bounded", "exponential"]),
        changed((*PIECE, "kind"), ...),
        changed((*PIECE, "rate"), ...),
        changed((*PIECE, "rate"), "fast"),
        changed((*PIECE, "rate"), None),
        changed((*PIECE, "rate"), -1.0),
        changed((*PIECE, "lower"), 0.2),
        changed((*PIECE, "colour"), 1.0),
        changed(("inverse_ttc", "distributions", "5-15", "weights"), [0.5, 0.6]),
        changed(("inverse_ttc", "distributions", "5-15", "weights"), [float("nan"), 1.0]),
        changed(("inverse_ttc", "distributions"), [1, 2]),
        changed(("inverse_ttc", "distributions", "15-25"), ...),
        changed(("counts", "15-25"), ...),
        changed(("counts", "15-25"), 0),
        changed(("counts", "15-25"), "many"),
        changed(("counts",), {}),
        lambda content: json.dumps(content)[:-40],
        lambda content: "",
        lambda content: "[]",
        lambda content: "\x00\x01",
    ],
)
def test_what_is_not_a_whole_law_is_refused(tmp_path, change):
    path = tmp_path / "law.json"
    write_law(path, LAW)
    path.write_text(change(json.loads(path.read_text(encoding="utf-8"))))
    with pytest.raises(InputError, match=r"law\.json: seen .*; expected "):
        read_law(path, ENCOUNTERS)


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
        {"lead_speeds": {"5-15": Empirical([6.0])}},
    ],
)
def test_parts_of_other_segments_are_refused(parts):
    with pytest.raises(ValueError, match=r"same segments|positive whole numbers"):
        replace(LAW, **parts)
