"""The sampler asks and is reported, is interrupted and goes on, and refuses states that it cannot take up."""

import json
from dataclasses import replace
from functools import reduce
from operator import getitem

import numpy as np
import pytest
from fewruns import InputError, Sampler, pools, read_state, state, two_phase, write_state
from fewruns.state import FORMAT, VERSION, sampler_of
from fewruns.typed_json import checksum
from sampler_checks import (
    STOPPING,
    drive,
    estimate,
    half_plane,
    new_sampler,
    numbers,
    resumed,
    saved,
    standard_normal_event,
)

MISSING = object()  # in the place of a value: the state lacks it
FEW = replace(STOPPING, maximum_simulations=120)  # ends in the phase of the estimate


@pytest.fixture(scope="module")
def whole():
    return drive(new_sampler(), half_plane(), FEW)


@pytest.mark.parametrize("pending", [False, True])
@pytest.mark.parametrize("batches", [0, 1, 4, 9])
def test_an_interrupted_run_ends_like_a_whole_one(whole, batches, pending):
    event = half_plane()
    sampler = new_sampler()
    for _ in range(batches):
        sampler.tell(*event.evaluate(sampler.ask(certify=sampler.is_narrow(FEW))))
    asked = sampler.ask(certify=sampler.is_narrow(FEW)).copy() if pending else None
    going_on = resumed(sampler)
    if pending:
        np.testing.assert_array_equal(going_on.ask(), asked)
    again = drive(going_on, event, FEW)
    assert whole.result.estimating > 0
    assert numbers(again.result) == numbers(whole.result)
    np.testing.assert_array_equal(again.sampler.progress.z, whole.sampler.progress.z)
    assert saved(again.sampler) == saved(whole.sampler)


@pytest.mark.parametrize("bits", [np.random.MT19937, np.random.Philox])
def test_any_generator_of_numpy_is_taken_up(bits):
    sampler = Sampler(2, np.random.Generator(bits(3)), fingerprint="")
    np.testing.assert_array_equal(resumed(sampler).ask(), sampler.ask())


def test_a_batch_is_asked_for_until_it_is_told():
    sampler = new_sampler(3, batch_size=7)
    first = sampler.ask().copy()
    assert first.shape == (7, 3)
    np.testing.assert_array_equal(sampler.ask(), first)
    sampler.tell(np.zeros(7, bool))
    assert (sampler.ask() != first).all()


@pytest.mark.parametrize(
    "reported", [(np.zeros(9, bool),), (np.zeros((10, 1), bool),), (np.zeros(10, bool), np.zeros(9)), (True,)]
)
def test_other_shapes_are_refused(reported):
    sampler = new_sampler()
    asked = sampler.ask()
    with pytest.raises(InputError, match="expected 10 flags and 10 scores"):
        sampler.tell(*reported)
    assert sampler.simulations == 0
    np.testing.assert_array_equal(sampler.ask(), asked)


def test_a_score_that_is_no_number_is_refused():
    sampler = new_sampler()
    sampler.ask()
    with pytest.raises(InputError, match="10 of them NaN"):
        sampler.tell(np.zeros(10, bool), np.full(10, np.nan))


def test_outcomes_are_only_received_once():
    sampler = new_sampler()
    for _ in range(2):
        sampler.ask()
    sampler.tell(np.zeros(10, bool))
    with pytest.raises(InputError, match="no requested batch"):
        sampler.tell(np.ones(10, bool))
    assert sampler.simulations == 10


@pytest.mark.parametrize("batch_size", [0, 501])
def test_other_batch_sizes_are_refused(batch_size):
    with pytest.raises(InputError, match="1 to 500"):
        new_sampler(batch_size=batch_size)


class Crash(Exception):  # noqa: N818
    """What interrupts a run."""


def test_nothing_is_simulated_twice(whole, tmp_path):
    simulated, reported = [], []
    event = half_plane()
    counted = replace(event, respond=lambda z: (simulated.append(z), event.respond(z))[1])
    path = tmp_path / "state.json"

    def interrupt(result):
        reported.append(result.simulations)
        if result.simulations == 60:
            raise Crash

    with pytest.raises(Crash):
        estimate(counted, 0, FEW, state_file=path, batch_size=10, on_batch=interrupt)
    assert reported == [10, 20, 30, 40, 50, 60]
    # The state has its own generator, so that the one given now is of no account.
    result = estimate(counted, 99, FEW, state_file=path, batch_size=10)
    assert numbers(result) == numbers(whole.result)
    z = np.vstack(simulated)
    assert len(np.unique(z, axis=0)) == len(z) == result.simulations
    assert numbers(estimate(counted, 7, FEW, state_file=path, batch_size=10)) == numbers(result)
    assert len(np.vstack(simulated)) == result.simulations


def test_a_tighter_target_goes_on_from_the_state(tmp_path):
    path = tmp_path / "state.json"
    rough, fine = (
        estimate(half_plane(), 2, replace(STOPPING, beta=beta), state_file=path) for beta in (0.4, 0.1)
    )
    assert rough.simulations < fine.simulations
    earlier = fine.tables["runs"][: rough.simulations]
    np.testing.assert_array_equal(earlier[["z_1", "z_2"]], rough.tables["runs"][["z_1", "z_2"]])
    assert (fine.high - fine.low) / 2 <= 0.1 * fine.probability * (1 + 1e-12)


@pytest.fixture(scope="module")
def content(tmp_path_factory):
    path = tmp_path_factory.mktemp("state") / "state.json"
    estimate(half_plane(), 0, FEW, state_file=path)
    return path.read_bytes()


@pytest.fixture
def file(tmp_path, content):
    """Return a file with the state of a run of 120 simulations."""
    path = tmp_path / "state.json"
    path.write_bytes(content)
    return path


def refused(path, problem=None, **settings):
    """Return the error of a method that is given a state file, which it must leave as it is."""
    content = path.read_bytes()
    with pytest.raises(InputError) as error:
        estimate(problem or half_plane(), 0, state_file=path, **settings)
    assert path.read_bytes() == content
    assert error.value.where == str(path)
    return error.value


def test_states_of_another_problem_or_batch_size_are_refused(file):
    other = refused(file, replace(half_plane(), fingerprint="another car"))
    assert "'half planes'" in other.seen
    assert "'another car'" in other.expected
    assert "dimension 2" in refused(file, half_plane_in(3)).seen
    assert "batch size 5" in refused(file, batch_size=20).seen


def half_plane_in(dimension):
    return standard_normal_event(lambda z: 4.0 - z[:, 0], dimension=dimension)


def test_a_sampler_of_another_version_is_rebuilt_from_its_runs(monkeypatch):
    event, sampler = half_plane(), new_sampler()
    drive(sampler, event, FEW)
    asked = sampler.ask()
    content = saved(sampler)
    monkeypatch.setattr(state, "VERSION", VERSION + 1)
    again = sampler_of(content, "a test")
    np.testing.assert_array_equal(again.progress.z, sampler.progress.z)
    np.testing.assert_array_equal(again.ask(), asked)  # these runs are outstanding, and their outcomes count
    again.tell(*event.evaluate(asked))
    assert again.simulations == sampler.simulations + 10
    found, before = again.estimate(STOPPING), sampler.estimate(STOPPING)
    assert (found.probability, found.low, found.high) == (before.probability, before.low, before.high)
    assert found.diagnostics["wide_draws"] == 0 < before.diagnostics["wide_draws"]  # nothing is certified
    assert drive(again, event).result.converged


def test_what_a_state_of_another_version_lacks_is_learnt_again(monkeypatch):
    sampler = drive(new_sampler(), half_plane(), FEW).sampler
    content = saved(sampler)
    for name in ("estimates", "repeats", "batches"):
        del content["state"]["progress"][name]
    del content["state"]["frequent"]
    version = VERSION + 1
    content |= {"version": version, "checksum": checksum([version, content["state"]])}
    again = sampler_of(content, "a test")
    assert again.simulations == sampler.simulations
    assert not again.estimate(STOPPING).probability > 0
    del content["state"]["progress"]["z"]
    content |= {"checksum": checksum([version, content["state"]])}
    with pytest.raises(InputError, match="KeyError: 'z'"):
        sampler_of(content, "a test")


def changed_number(text):
    """Return the text with one digit of a normal score changed."""
    score = json.loads(text)["state"]["progress"]["z"][5][1]
    digits = f"{score:.17g}"[:12]
    assert text.count(digits) == 1
    return text.replace(digits, digits[:-1] + str((int(digits[-1]) + 1) % 10))


def changed_flag(text):
    content = json.loads(text)
    content["state"]["progress"]["happened"][0] ^= True
    return json.dumps(content)


@pytest.mark.parametrize("change", [changed_number, changed_flag])
def test_damaged_states_are_refused(file, change):
    file.write_text(change(file.read_text()))
    assert "damaged" in refused(file).seen


@pytest.mark.parametrize(
    ("keys", "value"),
    [
        (["progress"], MISSING),
        (["progress", "z"], MISSING),
        (["generator", "state"], MISSING),
        (["progress", "happened", 3], MISSING),
        (["batch_size"], MISSING),
        (["batch_size"], "10"),
        (["batch_size"], 0),
        (["deterministic"], 1),
        (["theta"], [0.0]),
        (["axes"], [[1.0, 0.0]]),
        (["sites"], [[1.0], [1.0], [1.0]]),
        (["generator"], {"bit_generator": "seed"}),
        (["progress", "score"], [1.0]),
        (["progress", "happened"], [0.5] * 120),
        (["progress", "centres"], [[[0.0]]]),
        (["progress", "wide_draws"], [[1.0, 2.0]]),
        (["progress", "batches", 0], {"z": []}),
        (["progress", "batches", 0, "foreseen"], [[0.5]]),
        (["predecessor"], {"z": [[4.5, 0.0]], "happened": [False]}),
    ],
)
def test_states_that_do_not_fit_together_are_refused_even_with_a_right_checksum(file, keys, value):
    content = json.loads(file.read_text())
    *parents, last = keys
    place = reduce(getitem, parents, content["state"])
    place[last] = value
    if value is MISSING:
        del place[last]
    file.write_text(json.dumps(content | {"checksum": checksum([VERSION, content["state"]])}))
    assert "does not fit together" in refused(file).seen


def test_any_damage_to_the_bytes_of_a_state_is_refused(file):
    generator, whole = np.random.default_rng(10), file.read_bytes()
    for _ in range(100):
        start = int(generator.integers(len(whole)))
        length = int(generator.choice([0, 1, 5, 64, len(whole)]))  # left out, and others put in their place
        inside = generator.integers(256, size=generator.integers(1, 6), dtype=np.uint8).tobytes()
        damaged = whole[:start] + inside + whole[start + length :]
        if damaged.split() != whole.split():
            file.write_bytes(damaged)
            refused(file)


@pytest.mark.parametrize(
    "text", ["", "[1, 2]", "no JSON", "{}", '{"format": "something else"}', b"\xff\xfe", "half", "[" * 100000]
)
def test_files_that_are_no_state_are_refused(file, text):
    if text == "half":
        text = file.read_text()[: file.stat().st_size // 2]
    file.write_bytes(text if isinstance(text, bytes) else text.encode())
    assert FORMAT in refused(file).expected


def test_a_state_may_be_laid_out_anew(file):
    content = json.loads(file.read_text())
    file.write_text(json.dumps(content, sort_keys=True))
    assert saved(read_state(file)) == content


def test_a_pending_batch_does_not_tighten_the_bound():
    sampler = new_sampler(batch_size=500)
    before = sampler.estimate(STOPPING).high
    sampler.ask()
    assert sampler.estimate(STOPPING).high == before


def test_a_surrogate_that_expects_no_event_can_be_saved():
    pool = pools.Pool(np.zeros((50, 2)), *np.array([[1.0], [0.0], [1.0], [5.0]]) * np.ones(50))
    nothing = two_phase.expect(pool, 0.0)
    prediction = two_phase.predict(pool, nothing, 10, 100, pools.Defence())
    assert prediction.probability == 0
    json.dumps(prediction.variation, allow_nan=False)
    assert prediction.variation > 1e50


def test_a_score_of_minus_infinity_can_be_saved(tmp_path):
    event = standard_normal_event(lambda z: np.where(z[:, 0] > 4, -np.inf, 4.0 - z[:, 0]))
    result = estimate(event, 0, FEW, state_file=tmp_path / "state.json")
    assert result.events > 0


def test_a_state_that_cannot_be_written_leaves_the_earlier_one(file, monkeypatch):
    before = file.read_bytes()

    def full_disk(*_, **__):
        raise OSError("no space left")

    monkeypatch.setattr("pathlib.Path.write_text", full_disk)
    with pytest.raises(OSError, match="no space"):
        write_state(file, new_sampler())
    assert file.read_bytes() == before
    assert [path.name for path in file.parent.iterdir()] == [file.name]


def test_an_event_seen_once_is_no_silent_zero():
    sampler = new_sampler(5, seed=4)
    for batch in range(5):
        sampler.ask()
        sampler.tell((np.arange(10) == 0) & (batch == 0))
        result = sampler.estimate(STOPPING)
        assert result.events > 0
        assert result.high > 0
