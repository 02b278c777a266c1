"""Campaigns and laws of which a field was changed: each ends with one message."""

import contextlib
import copy
import io
import json
import re
from functools import reduce
from operator import getitem
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from accelerated_evaluation import InputError, cli, read_law
from builders import repeatable
from fewruns.typed_json import checksum
from hypothesis import assume, given
from hypothesis import strategies as st
from law_folder import begin_campaign, write_law_folder

often = repeatable(60)
DELETED, LONGER, NESTED = object(), object(), object()
VALUES = [
    DELETED, LONGER, NESTED, None, True, 0, -1, 0.5, 1e308, 10**30, float("nan"), float("-inf"),
    "", "text", [], [None], [1.0, 2.0], [[1.0]], {},
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


def refused(folder, content, capsys):
    """Write a campaign to a file, and return the message with which each command refuses it."""
    (folder / "d.json").write_text(json.dumps(content))
    for step in ("status d.json", "tell d.json done.csv", "ask d.json next --no-scenarios"):
        capsys.readouterr()
        assert cli.main(["campaign", *step.split()]) == 2
        error = capsys.readouterr().err
        assert error.startswith("error: d.json")
        assert error.count("\n") == 1
    return error


@often
@given(data=st.data())
def test_an_edited_campaign_is_refused(campaign, monkeypatch, capsys, data):
    folder, whole = campaign
    monkeypatch.chdir(folder)
    content = changed(whole, *data.draw(damages(whole)))
    assume(json.dumps(content) != json.dumps(whole))
    refused(folder, content, capsys)


@pytest.mark.parametrize(
    ("path", "value"),
    [
        (("version",), True),
        (("scenario",), "sailing"),
        (("law",), DELETED),
        (("law", "sha256"), None),
        (("quantity",), "noise"),
        (("goal", "alpha"), "0.2"),
        (("limits",), []),
        (("runs", 0), NESTED),
        (("runs", 0, "outcome", "crash"), 1),
        (("runs", 0, "encounter"), ["fast"]),
        (("sampler",), None),
        (("sampler", "state", "progress"), DELETED),
        (("sampler", "state", "progress", "score"), LONGER),
    ],
)
def test_a_campaign_that_does_not_fit_together_is_refused(campaign, monkeypatch, capsys, path, value):
    """The checksums agree here, as if a faulty program had written the file."""
    folder, whole = campaign
    monkeypatch.chdir(folder)
    content = changed(whole, path, value)
    if content["sampler"]:
        part = [content["sampler"]["version"], content["sampler"]["state"]]
        content["sampler"]["checksum"] = checksum(part)
    own = {name: value for name, value in content.items() if name not in ("format", "version", "checksum")}
    assert "checksum" not in refused(folder, content | {"checksum": checksum(own)}, capsys)


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
