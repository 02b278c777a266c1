"""A vehicle that is like another one: half of the simulations, the same truth, and what is refused."""

import json
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
import pytest
from accelerated_evaluation import cli
from accelerated_evaluation.base.errors import InputError
from accelerated_evaluation.base.files import write_csv
from accelerated_evaluation.methods.study import with_encounters
from accelerated_evaluation.methods.surrogate import Surrogate, read_predecessor
from accelerated_evaluation.problem import Problem
from accelerated_evaluation.publishing.explorer.payload import Payload, add_runs
from accelerated_evaluation.publishing.figures.sampled import fig36_crashes_among_runs
from accelerated_evaluation.scenarios.cut_in import CUT_IN
from accelerated_evaluation.track.campaign_file import read_campaign
from accelerated_evaluation.track.status import status_of
from accelerated_evaluation.vehicles import load_vehicle
from fewruns.gaussian_process import Predecessor
from fewruns.sampler import Sampler
from fewruns.state import State
from law_folder import LAW, begin_campaign
from sampler_checks import HALF_PLANE, STOPPING, drive, half_plane, numbers, standard_normal_event
from scipy.stats import ttest_1samp

SEEDS = 8
PROBLEM = Problem(CUT_IN, LAW, load_vehicle("acc_aeb"))


def runs_of(event, seed=100):
    """Return the runs of another vehicle, as the sampler chose them."""
    progress = drive(Sampler(2, np.random.default_rng(seed), 5, fingerprint="other"), event).sampler.progress
    return Predecessor(progress.z, progress.happened)


def successors(predecessor, event=None, seeds=SEEDS):
    surrogate = Surrogate(predecessor=predecessor)
    event = half_plane() if event is None else event
    return [surrogate.estimate(event, STOPPING, np.random.default_rng(seed)) for seed in range(seeds)]


def ratios(results):
    return np.array([result.probability for result in results]) / HALF_PLANE


@pytest.fixture(scope="module")
def like():
    """Estimates of the half plane at 4, from the runs of one at 4.2."""
    return successors(runs_of(half_plane(4.2)))


def test_the_runs_of_a_like_vehicle_save_half_and_do_not_mislead(like):
    alone = successors(None)
    assert all(result.converged for result in like)
    assert ttest_1samp(ratios(like), 1).pvalue > 0.01
    assert np.sqrt(np.mean((ratios(like) - 1) ** 2)) < 0.25
    # The predecessor's own probability, which is .41 of the truth, would be a wrong answer.
    assert ttest_1samp(ratios(like) - 0.41, 0).pvalue < 1e-6
    spent = [np.mean([result.simulations for result in results]) for results in (like, alone)]
    assert spent[0] < 0.7 * spent[1]


def test_a_predecessor_that_is_not_alike_costs_runs_and_not_the_truth(like):
    other = standard_normal_event(lambda z: 4 - z @ [0.0, 1.0])
    results = successors(runs_of(other))
    assert (np.abs(np.log(ratios(results))) < np.log(2)).all()
    mean = [np.mean([result.simulations for result in part]) for part in (results, like)]
    assert mean[0] > mean[1]


def test_a_vehicle_that_never_fails_after_one_that_did_has_a_bound():
    never = standard_normal_event(lambda z: np.ones(len(z)))
    stopping = STOPPING.__class__(alpha=0.2, beta=0.2, minimum_events=1, maximum_simulations=60)
    result = Surrogate(predecessor=runs_of(half_plane())).estimate(never, stopping, np.random.default_rng(1))
    assert (result.probability, result.events, result.converged) == (0, 0, False)
    assert 0 < result.high < 1


def test_the_state_keeps_the_predecessor():
    event, predecessor = half_plane(), runs_of(half_plane(4.2))
    whole = Sampler(2, np.random.default_rng(3), 5, fingerprint="x", predecessor=predecessor)
    whole.tell(*event.evaluate(whole.ask()))
    content = json.loads(json.dumps(whole.state().to_json(), allow_nan=False))
    resumed = Sampler.resume(State.from_json(content, "a test"))
    ends = [drive(sampler, event) for sampler in (whole, resumed)]
    assert numbers(ends[0].result) == numbers(ends[1].result)
    np.testing.assert_array_equal(ends[0].sampler.progress.z, ends[1].sampler.progress.z)


@pytest.mark.parametrize(
    ("z", "happened", "message"),
    [
        (np.zeros((3, 2)), np.zeros(3, bool), "no event"),
        (np.zeros((3, 3)), np.ones(3, bool), r"shape \(3, 3\) for 3 flags"),
        (np.zeros((3, 2)), np.ones(2, bool), r"shape \(3, 2\) for 2 flags"),
    ],
)
def test_runs_that_do_not_fit_are_refused(z, happened, message):
    with pytest.raises(ValueError, match=message):
        Sampler(2, np.random.default_rng(0), fingerprint="x", predecessor=Predecessor(z, happened))


# ---- on the proving ground


def driven(step, name, batches):
    """Drive some batches of a campaign with the built-in car."""
    for _ in range(batches):
        assert step("ask", "next", "--no-scenarios") == 0
        assert cli.main(["simulate", "next/runs.csv", "done.csv"]) == 0
        assert step("tell", "done.csv") == 0
    return read_campaign(name)


@pytest.fixture
def first(tmp_path, monkeypatch):
    """A campaign that has met the event, and a function that runs one step of it."""
    monkeypatch.chdir(tmp_path)
    step = begin_campaign(tmp_path)
    while not status_of(driven(step, "c.json", 1)).may_stop:
        pass
    return step


def begin_next(*options):
    files = ("--law", "law.json", "--encounters", "encounters.parquet", "--half-width", "0.5")
    return cli.main(
        [
            "campaign",
            "new",
            "next.json",
            *files,
            "--deterministic",
            "yes",
            "--predecessor",
            "c.json",
            *options,
        ]
    )


def test_a_campaign_begins_where_its_predecessor_met_the_event(first):
    old = read_campaign("c.json")
    assert begin_next("--batch-size", "5") == 0

    def step(name, *arguments):
        return cli.main(["campaign", name, "next.json", *map(str, arguments)])

    new = driven(step, "next.json", 4)
    assert new.sampler.progress.happened.any()  # a search takes 20 runs and more before it knows anything
    np.testing.assert_array_equal(new.sampler.predecessor.z, old.sampler.progress.z)


def test_another_law_or_event_is_no_predecessor(first, capsys):
    assert begin_next("--event", "min_range=1") == 2
    assert "--predecessor, its event: seen crash; expected min range at most 1 m" in capsys.readouterr().err
    law = json.loads(Path("law.json").read_text())
    Path("law.json").write_text(json.dumps(law | {"description": "another"}))
    assert begin_next() == 2
    assert "--predecessor, its law: seen" in capsys.readouterr().err
    assert not Path("next.json").exists()


def test_a_campaign_without_events_is_no_predecessor(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    begin_campaign(tmp_path)
    assert begin_next() == 2
    assert "no event in 0 runs of complete batches" in capsys.readouterr().err


# ---- the table of an earlier estimate


@pytest.fixture(scope="module")
def table():
    """Some simulations as `estimate` writes them."""
    z = np.random.default_rng(5).normal(size=(30, 3))
    runs = pd.DataFrame({f"z_{k + 1}": z[:, k] for k in range(3)}).assign(event=np.arange(30) > 25)
    return with_encounters(runs, PROBLEM)


def test_a_table_of_simulations_is_read(table, tmp_path):
    write_csv(tmp_path / "runs.csv", table)
    known = read_predecessor(tmp_path / "runs.csv", PROBLEM)
    np.testing.assert_allclose(known.z[:, 2], table["z_closing_speed"])
    assert known.happened.sum() == 4


def test_a_table_of_simulations_is_drawn_and_in_the_explorer(table):
    crashes = table[table["event"]].assign(share=0.25)
    records = table.assign(inverse_ttc=table["closing_speed"] / table["range"])
    _, data = fig36_crashes_among_runs(table, crashes, records, "made up")
    plt.close("all")
    np.testing.assert_array_equal(data[list(CUT_IN.names)], table[list(CUT_IN.names)])
    assert data["share"].tolist() == 26 * [0.0] + 4 * [0.25]
    payload = Payload({})
    add_runs(payload, table.assign(phase=["repeat", *29 * ["learn"]]))
    own = {name: [29] for name in ("run_lead_speed", "run_range", "run_closing_speed", "run_crash")}
    assert {name: place["shape"] for name, place in payload.text["arrays"].items()} == own


@pytest.mark.parametrize(
    ("spoil", "message"),
    [
        (lambda t: t.drop(columns="z_lead_speed"), "z_lead_speed"),
        (lambda t: t.assign(event=False), "no event in 30 simulations"),
        (lambda t: t.assign(event="maybe"), "'maybe'"),
        (lambda t: t.assign(z_closing_speed="far"), "far"),
        (lambda t: t.assign(closing_speed=t["closing_speed"] * 1.01), "another law"),
    ],
)
def test_a_table_that_does_not_fit_is_refused(table, tmp_path, spoil, message):
    write_csv(tmp_path / "runs.csv", spoil(table))
    with pytest.raises(InputError, match=message):
        read_predecessor(tmp_path / "runs.csv", PROBLEM)


def test_no_table_is_refused(tmp_path):
    with pytest.raises(InputError, match="no such file"):
        read_predecessor(tmp_path / "none.csv", PROBLEM)
