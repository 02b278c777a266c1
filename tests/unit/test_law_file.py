"""The model file: what is read back is equal to what was written, and nothing else is read."""

import json
import math

import pytest
from accelerated_evaluation.distributions import (
    BoundedExponential,
    BoundedNormal,
    Mixture,
    Pareto,
    PiecewiseMixture,
)
from accelerated_evaluation.errors import InputError
from accelerated_evaluation.laws.lane_change_model import (
    LaneChangeModel,
    from_dict,
    read_model,
    to_dict,
    write_model,
)

BODY = Mixture((0.1, 0.9), (BoundedNormal(0.1 / 3, 0.0, 0.166), BoundedNormal(0.07, 0.0, 0.166, -1e-17)))
PIECEWISE = PiecewiseMixture((0.95, 0.05), (BODY, BoundedExponential(21.084581450393657, 0.166)))
MODEL = LaneChangeModel(
    "made up for a test: Größe",
    {"5-15": 75783, "15-25": 3},
    Pareto(1.7320507600110688, 1 / 75),
    {"5-15": PIECEWISE, "15-25": BoundedExponential(-3.0, 0.0, 2.0)},
)


@pytest.mark.parametrize(
    "law",
    [
        BoundedExponential(1 / 3, 0.1),
        BoundedExponential(-1e-300, -1.0, 1.0),
        BoundedNormal(5e-324, -math.inf, math.inf, -0.1),
        Pareto(math.pi, 1 / 75),
        BODY,
        PIECEWISE,
        PIECEWISE.accelerated((-3.7, 20.1), (0.01, 0.99)),
    ],
)
def test_every_kind_comes_back_equal(law):
    back = from_dict(json.loads(json.dumps(to_dict(law), allow_nan=False)))
    assert back == law
    assert type(back) is type(law)


def test_a_model_comes_back_equal_and_is_written_equally(tmp_path):
    first, second = tmp_path / "first.json", tmp_path / "second.json"
    write_model(first, MODEL)
    model = read_model(first)
    assert model == MODEL
    assert model.segments == ("5-15", "15-25")
    assert model.share("15-25") == 3 / 75786
    assert model.n_parameters == 1 + 5 + 1
    write_model(second, model)
    assert first.read_bytes() == second.read_bytes()


def changed(path, value):
    """Return the content of the model's file with one place changed, or left out if the value is ``...``."""

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
        changed(("version",), 2),
        changed(("version",), ...),
        changed(("format",), "something else"),
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
        changed(("events", "15-25"), ...),
        changed(("events", "15-25"), 0),
        changed(("events", "15-25"), "many"),
        changed(("events",), {}),
        lambda content: json.dumps(content)[:-40],
        lambda content: "",
        lambda content: "[]",
        lambda content: "\x00\x01",
    ],
)
def test_what_is_not_a_whole_model_is_refused(tmp_path, change):
    path = tmp_path / "model.json"
    write_model(path, MODEL)
    path.write_text(change(json.loads(path.read_text(encoding="utf-8"))))
    with pytest.raises(InputError, match=r"model\.json: seen .*; expected "):
        read_model(path)


def test_a_missing_file_and_other_bytes_are_refused(tmp_path):
    with pytest.raises(InputError, match="no such file"):
        read_model(tmp_path / "none.json")
    (tmp_path / "model.json").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(InputError, match="whole model file"):
        read_model(tmp_path / "model.json")
