"""The digests by which the code of the library, and the files and settings of a user, count."""

import hashlib

from accelerated_evaluation import SOURCES
from accelerated_evaluation.base.files import content_digest, value_digest
from accelerated_evaluation.study import dependencies
from accelerated_evaluation.study.configuration import load
from accelerated_evaluation.study.dependencies import code_up_to, in_order, without_unused


def test_the_code_of_a_room_and_of_those_before_it_counts(tmp_path, monkeypatch):
    for name in ("base/errors.py", "records/checks/units.py", "laws/files.py", "study/jobs.py"):
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text("x = 1")
    monkeypatch.setattr(dependencies, "LIBRARY", tmp_path)

    def changed(name: str) -> set[str]:
        """Return the rooms up to the records that have another digest after an edit of a file."""
        dependencies.digest_of.cache_clear()
        before = code_up_to("records")
        (tmp_path / name).write_text("x = 2")
        dependencies.digest_of.cache_clear()
        return {room for room, digest in code_up_to("records").items() if digest != before[room]}

    assert changed("records/checks/units.py") == {"records"}
    assert changed("base/errors.py") == {"base"}
    assert changed("study/jobs.py") == {"study/jobs"}
    assert changed("laws/files.py") == set()
    dependencies.digest_of.cache_clear()


def test_content_counts_and_dates_and_names_do_not(tmp_path):
    one, two = tmp_path / "one.csv", tmp_path / "two.csv"
    one.write_text("1\n")
    two.write_text("1\n")
    assert content_digest([one]) == content_digest([two])
    two.write_text("2\n")
    assert content_digest([one]) != content_digest([two])
    assert content_digest([one, two]) != content_digest([two, one])


def test_a_file_to_be_retrieved_counts_as_the_one_that_will_come(tmp_path):
    path = tmp_path / "records.mat"
    foreseen = content_digest([path], missing=hashlib.sha256(b"1\n").hexdigest())
    path.write_text("1\n")
    assert content_digest([path]) == foreseen


def test_the_order_of_keys_does_not_count():
    one, two = {"a": 1, "b": [{"c": 2, "d": 3}]}, {"b": [{"d": 3, "c": 2}], "a": 1}
    assert repr(in_order(one)) == repr(in_order(two))
    assert value_digest(one) == value_digest(two)
    assert value_digest(one) != value_digest(one | {"a": 2})


def test_sources_that_are_not_used_do_not_count():
    config = load()
    other = {**config["data"], "table": {**config["data"]["table"], "path": "mine.csv"}}
    assert without_unused(config, SOURCES) == without_unused({**config, "data": other}, SOURCES)
    assert set(without_unused(config, SOURCES)["data"]) & set(SOURCES) == {config["data"]["source"]}
