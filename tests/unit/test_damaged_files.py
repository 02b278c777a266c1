"""Files that a program wrote, of which any field was changed: states of a sampler, campaigns and laws.

States and campaigns have a checksum, which is made anew here.

Nobody does this by accident. But a file that a person edited, or that a faulty program wrote, ends with one
message too, and never as a state that fails later.
"""

import contextlib
import copy
import io
import json
import re
from functools import cache, reduce
from operator import getitem
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from accelerated_evaluation import cli
from accelerated_evaluation.base.errors import InputError
from accelerated_evaluation.laws.files import read_law
from accelerated_evaluation.methods.estimate import Stopping
from accelerated_evaluation.records.encounter_table import read_encounters
from accelerated_evaluation.track import campaign_file
from fewruns import state
from fewruns.gaussian_process import Predecessor
from fewruns.sampler import Sampler
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from law_folder import begin_campaign, write_law_folder

GOAL = Stopping(alpha=0.2, beta=0.2, minimum_events=1)
often = settings(
    max_examples=150,
    derandomize=True,
    deadline=None,
    database=None,
    suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow],
)
DELETED, LONGER, NESTED = object(), object(), object()
VALUES = [
    DELETED, LONGER, NESTED, None, True, 0, -1, 0.5, 1e308, 10**30, float("nan"), float("-inf"),
    "", "text", [], [None], [1.0, 2.0], [[1.0]], {}, {"kind": "WideBatch"},
]  # fmt: skip


def paths(content, path=()):
    """Yield the paths of all fields of a content; of a list the first and the last."""
    if path:
        yield path
    if isinstance(content, dict):
        for name, value in content.items():
            yield from paths(value, (*path, name))
    elif isinstance(content, list) and content:
        for place in {0, len(content) - 1}:
            yield from paths(content[place], (*path, place))


def changed(content, path, value):
    """Return a copy of a content in which a field is deleted, longer, nested or of another value."""
    content = copy.deepcopy(content)
    *parents, last = path
    section = reduce(getitem, parents, content)
    if value is DELETED:
        del section[last]
    elif value is LONGER:
        section[last] = [*section[last], *section[last][-1:]] if isinstance(section[last], list) else []
    else:
        section[last] = [section[last]] if value is NESTED else value
    return content


def damages(content):
    return st.tuples(st.sampled_from(sorted(paths(content), key=str)), st.sampled_from(VALUES))


def driven(batches, predecessor=None):
    """Return the state of a sampler that has seen so many batches, and has asked for another."""
    sampler = Sampler(2, np.random.default_rng(1), 10, fingerprint="x", predecessor=predecessor)
    for _ in range(batches):
        z = sampler.ask()
        sampler.tell(z[:, 0] > 3.5, 3.5 - z[:, 0])
    sampler.ask()
    return json.loads(json.dumps(sampler.state().to_json()))["state"]


ALIKE = Predecessor(np.array([[3.6, 0.1], [3.0, 0.2], [3.8, -1.0]]), np.array([True, False, True]))


@cache
def states():
    """Return states of samplers; they are made for the first test, and not where tests are collected."""
    return [driven(1), driven(5), driven(14), driven(3, ALIKE)]


@often
@given(st.data())
def test_a_state_is_refused_or_the_sampler_goes_on(data):
    content = data.draw(st.sampled_from(states()))
    content = changed(content, *data.draw(damages(content)))
    whole = {
        "format": state.FORMAT,
        "version": state.VERSION,
        "checksum": state._checksum(content),
        "state": content,
    }
    try:
        sampler = Sampler.resume(state.State.from_json(whole, "state.json"))
    except InputError as error:
        assert str(error).startswith("state.json")  # noqa: PT017
        return
    with np.errstate(all="ignore"):
        z = sampler.ask()
        sampler.tell(z[:, 0] > 3.5, 3.5 - z[:, 0])
        sampler.estimate(GOAL)
    json.dumps(sampler.state().to_json(), allow_nan=False)


@pytest.mark.parametrize("value", [[[1.0], [1.0], [1.0]], [[1.0, 2.0]], [], [[[1.0]], [[1.0]]]])
def test_sites_of_another_shape_are_named(value):
    content = changed(states()[1], ("sites",), value)
    whole = {"format": state.FORMAT, "version": state.VERSION, "state": content}
    with pytest.raises(InputError, match="sites has the shape"):
        state.State.from_json(whole | {"checksum": state._checksum(content)}, "state.json")


@pytest.mark.parametrize("part", ["progress", "pending"])
def test_a_zone_of_rarity_without_a_width_is_refused(part):
    path = ("progress", "wide_draws") if part == "progress" else ("progress", "pending", "wide_draws")
    waiting = next(
        content for content in states() if (content["progress"]["pending"] or {}).get("wide_draws")
    )
    content = changed(waiting, (*path, 0, 2), 0)
    whole = {"format": state.FORMAT, "version": state.VERSION, "state": content}
    with pytest.raises(InputError, match="a zone of rarity that does not end above its beginning"):
        state.State.from_json(whole | {"checksum": state._checksum(content)}, "state.json")


@pytest.fixture(scope="module")
def campaign(tmp_path_factory):
    """A folder with a campaign of which half a batch is reported, and the content of its file."""
    with (
        contextlib.chdir(tmp_path_factory.mktemp("campaign")) as _,
        contextlib.redirect_stdout(io.StringIO()),
    ):
        step = begin_campaign(Path.cwd(), "--host-speed-max", "60")
        for part in (10, 10, 10, 4):
            step("ask", "next", "--no-scenarios")
            cli.main(["simulate", "next/runs.csv", "done.csv"])
            pd.read_csv("done.csv").head(part).to_csv("reported.csv", index=False)
            step("tell", "reported.csv")
        return Path.cwd(), json.loads(Path("c.json").read_text())


@often
@given(data=st.data(), version=st.sampled_from([state.VERSION, state.VERSION - 1]))
def test_a_campaign_is_refused_or_goes_on(campaign, monkeypatch, capsys, data, version):
    folder, whole = campaign
    monkeypatch.chdir(folder)
    content = {name: value for name, value in whole.items() if name not in ("format", "version", "checksum")}
    content = changed(content, *data.draw(damages(content)))
    if isinstance(content.get("sampler"), dict) and "state" in content["sampler"]:
        digest = state._checksum(content["sampler"]["state"])
        content["sampler"] |= {"checksum": digest, "version": version}
    head = {"format": campaign_file.FORMAT, "version": campaign_file.VERSION}
    text = json.dumps(head | {"checksum": campaign_file._checksum(content)} | content)
    (folder / "d.json").write_text(text)
    capsys.readouterr()
    steps = ["status d.json", "tell d.json done.csv", "ask d.json next --no-scenarios"]
    if all(cli.main(["campaign", *step.split()]) == 0 for step in steps):
        return
    error = capsys.readouterr().err
    assert error.startswith("error: ")
    assert error.count("\n") == 1


@pytest.fixture(scope="module")
def law_folder(tmp_path_factory):
    """A folder with a law file and its encounter table, and the content of the law file."""
    folder = tmp_path_factory.mktemp("law")
    law, encounters = write_law_folder(folder)
    return folder, json.loads(law.read_text()), pd.read_parquet(encounters)


@often
@given(data=st.data())
def test_a_law_is_refused_or_gives_cut_ins(law_folder, data):
    folder, content, encounters = law_folder
    (folder / "odd.json").write_text(json.dumps(changed(content, *data.draw(damages(content)))))
    try:
        law = read_law(folder / "odd.json", encounters)
    except InputError as error:
        assert re.search(r"odd\.json(?:, the encounter table of this law)?: seen", str(error))  # noqa: PT017
        return
    with np.errstate(all="ignore"):
        x = law.draw(200, np.random.default_rng(1))
    assert law.closing_speed_max > 0
    assert (x[:, 1] > 0).all()
    assert (x[:, 2] >= 0).all()


@pytest.mark.parametrize("speed", [np.nan, np.inf, -1.0, "fast", None])
def test_encounter_tables_with_other_than_possible_numbers_are_refused(law_folder, speed):
    folder, _, encounters = law_folder
    encounters.assign(lead_speed=speed).to_parquet(folder / "odd.parquet")
    with pytest.raises(InputError, match=r"odd\.parquet: seen speeds, ranges or times that are missing"):
        read_encounters(folder / "odd.parquet")
