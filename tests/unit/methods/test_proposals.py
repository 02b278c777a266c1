"""What searches found, and the file that keeps it: read back equal, and refused where it is damaged."""

import dataclasses
import json

import pytest
from accelerated_evaluation.base.errors import InputError
from accelerated_evaluation.methods.cross_entropy.search import Proposals, read_proposals, write_proposals
from toy_segment import PAPERS, F, found, toy


def proposals():
    searches = {
        f"{method} {seed}": found(method, toy(1e-1, 1e-3), seed) for seed, method in enumerate(PAPERS)
    }
    return searches, Proposals.of(searches)


def test_proposals_come_back_equal(tmp_path):
    searches, kept = proposals()
    assert kept.factors == {name: search.proposal for name, search in searches.items()}
    assert kept.simulations == {name: search.simulations for name, search in searches.items()}
    assert kept.total == sum(search.simulations for search in searches.values()) > 0
    first, second = tmp_path / "first.json", tmp_path / "second.json"
    write_proposals(first, kept)
    back = read_proposals(first)
    assert back == kept
    assert list(back.factors) == list(kept.factors)
    write_proposals(second, back)
    assert first.read_bytes() == second.read_bytes()
    other = dataclasses.replace(kept, simulations=kept.simulations | {"single 2": 1})
    assert other != kept


def test_an_unfinished_search_is_kept_with_its_reason(tmp_path):
    _, kept = proposals()
    path, name = tmp_path / "unfinished.json", next(iter(kept.factors))
    assert not kept.unfinished
    unfinished = dataclasses.replace(kept, unfinished={name: "the search did not come to the event"})
    write_proposals(path, unfinished)
    assert read_proposals(path) == unfinished
    assert unfinished.only(name).unfinished == unfinished.unfinished
    assert not unfinished.only(list(kept.factors)[1]).unfinished


def test_proposals_of_one_stratum():
    searches, kept = proposals()
    alone = kept.only("piecewise 1")
    assert alone.factors == {"piecewise 1": searches["piecewise 1"].proposal}
    assert alone.total == searches["piecewise 1"].simulations < kept.total


@pytest.mark.parametrize(
    "damage",
    [
        lambda text: text[:-30],
        lambda text: "",
        lambda text: "[]",
        lambda text: text.replace('"second"', '"third"'),
        lambda text: text.replace('"simulations"', '"simulation"'),
        lambda text: text.replace("bounded exponential", "Weibull"),
        lambda text: text.replace('"rate"', '"speed"'),
        lambda text: json.dumps(json.loads(text) | {"slow": 3}),
    ],
)
def test_damaged_proposals_are_refused(tmp_path, damage):
    path = tmp_path / "proposals.json"
    write_proposals(path, Proposals({"slow": F}, {"slow": 7000}))
    text = path.read_text(encoding="utf-8")
    assert damage(text) != text
    path.write_text(damage(text), encoding="utf-8")
    with pytest.raises(InputError, match=r"proposals\.json: seen .*; expected a file of accelerated"):
        read_proposals(path)
