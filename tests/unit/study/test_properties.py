"""Properties that hold for any input: readers, validation, distributions, fits and vehicles, with hypothesis.

The examples are the same in every run. What is refused is refused with an `InputError` alone.
"""

import copy
import json
import warnings
from contextlib import suppress
from functools import reduce
from operator import getitem

import fewruns
import numpy as np
import pandas as pd
import pytest
from accelerated_evaluation.base.errors import InputError
from accelerated_evaluation.laws.distributions import BoundedExponential, BoundedNormal, Pareto
from accelerated_evaluation.laws.paper.piecewise import EXPONENTIAL, PieceFamily, fit_piecewise, usable_knots
from accelerated_evaluation.records.ingest import Account, ingest
from accelerated_evaluation.records.segments import require_rows
from accelerated_evaluation.records.sources import read_source
from accelerated_evaluation.scenarios.cut_in import CUT_IN, Outcomes
from accelerated_evaluation.scenarios.parameters import required_names
from accelerated_evaluation.study.configuration import ConfigurationError, load, read_yaml, validate
from accelerated_evaluation.vehicles.external.checked import CheckedVehicle
from accelerated_evaluation.vehicles.protocol import VEHICLES
from builders import repeatable
from fewruns.state import sampler_of
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

few = repeatable(25)
cells = st.one_of(
    st.floats(-1e3, 1e3).map(str),
    st.floats().map(str),
    st.text(max_size=8),
    st.sampled_from(["", "nan", "12,5"]),
)
CONFIG = load()
names = st.sampled_from(["lead_speed", "range", "closing_speed", "other", ""])
speeds = st.floats(0, 60)


def table(folder, content, invalid_rows="drop"):
    """Write a CSV table and return a configuration that reads it."""
    path = folder / "mine.csv"
    path.write_bytes(content)
    config = copy.deepcopy(CONFIG)
    config["data"] |= {"source": "table", "invalid_rows": invalid_rows}
    config["data"]["table"]["path"] = str(path)
    return config


def taken(config):
    """Read, filter and check the records of a configuration."""
    sections = config["data"], config["filters"], config["segments"]["lead_speed_edges"]
    raw = read_source(config["data"], np.random.default_rng(1))
    encounters = ingest(raw, *sections, account := Account(len(raw)))
    require_rows(encounters)
    return encounters, account.table()


# ---------------------------------------------------------------- readers and validation


@few
@given(
    header=st.lists(names, min_size=1, max_size=5),
    rows=st.lists(st.lists(cells, max_size=5), max_size=6),
    policy=st.sampled_from(["drop", "refuse"]),
)
def test_any_table_is_read_or_refused(tmp_path, header, rows, policy):
    text = "\n".join(",".join(row) for row in [header, *rows])
    with pytest.raises(InputError):  # six rows are too few for any study
        taken(table(tmp_path, text.encode(errors="replace"), policy))


@few
@given(content=st.binary(max_size=200))
def test_any_bytes_are_refused_as_table_state_and_configuration(tmp_path, content):
    with pytest.raises(InputError):
        taken(table(tmp_path, content))
    with pytest.raises(fewruns.InputError):
        fewruns.read_state(tmp_path / "mine.csv")
    with suppress(InputError):
        read_yaml(tmp_path / "mine.csv")


@few
@given(seed=st.integers(0, 1000), odd=st.lists(cells, max_size=3), digits=st.integers(0, 3))
def test_every_row_of_a_table_is_kept_or_accounted_for(tmp_path, seed, odd, digits):
    generator = np.random.default_rng(seed)
    rows = np.column_stack(
        [generator.uniform(6, 34, 300), generator.uniform(5, 70, 300), generator.exponential(2, 300)]
    )
    frame = pd.DataFrame(rows.round(digits), columns=["lead_speed", "range", "closing_speed"]).astype(str)
    frame.loc[: len(odd) - 1, "range"] = odd
    encounters, account = taken(table(tmp_path, frame.to_csv(index=False).encode(errors="replace")))
    assert account["rows_in"].iloc[0] == 300
    assert account["rows_dropped"].sum() + len(encounters) == 300
    assert np.isfinite(encounters.drop(columns="segment")).all(axis=None)


def keys(section, path=()):
    """Yield the paths of all keys of a configuration."""
    for name, value in section.items():
        yield (*path, name)
        if isinstance(value, dict):
            yield from keys(value, (*path, name))


values = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=10),
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.text(max_size=5), inner, max_size=3),
    max_leaves=5,
)


@settings(few, max_examples=60)
@given(path=st.sampled_from(sorted(keys(CONFIG))), value=values)
def test_any_value_of_any_key_is_taken_or_refused_with_its_key(path, value):
    config = copy.deepcopy(CONFIG)
    *parents, name = path
    reduce(getitem, parents, config)[name] = value
    reported = ""
    try:
        validate(config)
    except ConfigurationError as error:
        reported = str(error)
    assert not reported or path[0] in reported


# ---------------------------------------------------------------- distributions and fits

shifted = st.floats(1e-6, 10)
distributions = st.one_of(
    st.builds(
        lambda rate, low, width: BoundedExponential(rate, low, low + width),
        st.floats(-300, 300),
        st.floats(0, 5),
        st.floats(1e-3, 50),
    ),
    st.builds(BoundedExponential, st.floats(1e-3, 1e3), st.floats(0, 5)),
    st.builds(
        lambda sd, low, width: BoundedNormal(sd, low, low + width),
        st.floats(1e-2, 50),
        st.floats(0, 0.5),
        st.floats(1e-3, 50),
    ),
    st.builds(Pareto, st.floats(0.1, 50), shifted),
)


@few
@given(law=distributions, q=arrays(float, 5, elements=st.floats(0, 1)))
def test_quantiles_and_probabilities_belong_together(law, q):
    for x, p in ((law.ppf(q), q), (law.isf(q), 1 - q)):
        assert not np.isnan(x).any()
        assert ((law.lower <= x) & (x <= law.upper)).all()
        np.testing.assert_allclose(law.cdf(x), p, atol=1e-7)
        np.testing.assert_allclose(law.cdf(x) + law.sf(x), 1, atol=1e-12)
        inside = (x > law.lower) & (x < law.upper)
        assert np.isfinite(law.logpdf(x[inside])).all()
    x = law.ppf(np.sort(q))
    assert (x[1:] >= x[:-1]).all()


@few
@given(
    x=arrays(float, st.integers(2, 60), elements=st.floats(0, 0.999)),
    top=st.sampled_from([1.0, np.inf]),
    components=st.integers(1, 3),
)
def test_every_piece_can_be_fitted_to_any_sample_that_varies(x, top, components):
    assume(np.unique(x).size >= 2)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        law = PieceFamily("bounded normal", components).fit_or_simpler(x, 0.0, top)
    assert np.isfinite(law.logpdf(x[x > 0])).all()
    assert law.mean() == pytest.approx(x.mean(), rel=0.5, abs=0.3)


@few
@given(
    x=arrays(float, st.integers(8, 60), elements=st.floats(0, 3)),
    knot=st.floats(-1, 5),
    scale=st.sampled_from([1, 1, 1e-150, 1e-156, 1e-300, 1e-310]),
)
def test_pieces_with_any_knot_add_up_to_one(x, knot, scale):
    x, knot = x * scale, knot * scale
    assume(np.unique(x).size >= 4)
    law = fit_piecewise(x, 0.0, usable_knots(x, [knot]), [EXPONENTIAL] * 2)
    assert law.cdf(law.upper) == pytest.approx(1)
    assert float(sum(law.weights)) == pytest.approx(1)
    assert np.isfinite(law.logpdf(x)).all()


# ---------------------------------------------------------------- vehicles


@few
@given(
    name=st.sampled_from(sorted(name for name in VEHICLES if not required_names(VEHICLES[name]))),
    encounters=st.lists(st.tuples(speeds, st.floats(0.01, 500), st.floats(-60, 60)), min_size=1, max_size=5),
)
def test_built_in_vehicles_keep_the_contract(name, encounters):
    lead_speed, range_, closing_speed = np.array(encounters).T
    vehicle = CheckedVehicle(VEHICLES[name](), name, CUT_IN)
    outcomes = vehicle.simulate(lead_speed, range_, np.maximum(closing_speed, -lead_speed))
    assert outcomes.crash.shape == lead_speed.shape


column = st.one_of(
    arrays(st.sampled_from([float, bool, np.int64, np.float32, "U3", object]), st.integers(0, 4)),
    st.none(),
    st.lists(st.floats(), max_size=4),
    st.floats(),
)


@few
@given(crash=column, min_range=column, min_ttc=column, impact_speed=column)
def test_whatever_a_vehicle_gives_is_taken_or_refused(crash, min_range, min_ttc, impact_speed):
    class Odd:
        def simulate(self, lead_speed, range_, closing_speed):
            return Outcomes(crash, min_range, min_ttc, impact_speed)

    with suppress(InputError):
        outcomes = CheckedVehicle(Odd(), "Odd", CUT_IN).simulate([20.0, 20.0], [10.0, 20.0], [5.0, 1.0])
        assert {values.shape for values in vars(outcomes).values()} == {(2,)}


@few
@given(content=st.recursive(st.none() | st.integers() | st.text(max_size=9), st.lists, max_leaves=4))
def test_no_json_but_a_state_is_taken_for_one(content):
    for odd in (content, {"format": content}, {"state": content, "checksum": content}):
        with pytest.raises(fewruns.InputError):
            sampler_of(json.loads(json.dumps(odd)), "state.json")
