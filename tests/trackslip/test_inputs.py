"""The files that a command read, by digests of their content."""

import hashlib
import json
from pathlib import Path

import pytest

from trackslip.inputs import Inputs, content_digest, note_input, note_listing, recorded


def written(path, text):
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text, encoding="utf-8")
    return path


def sha256(text):
    return hashlib.sha256(text.encode()).hexdigest()


def test_a_files_digest_is_that_of_its_content(tmp_path):
    text = "t,omega_l\n0,1\n"
    assert content_digest(written(tmp_path / "log.csv", text)) == sha256(text)


def test_a_summary_is_the_same_whatever_time_it_took(tmp_path):
    """And in whatever order its entries stand, but not with other numbers."""
    digests = [
        content_digest(written(tmp_path / str(k) / "summary.json", json.dumps(summary)))
        for k, summary in enumerate(
            (
                {"best": "icr", "D": 0.05, "timing": {"fit": 1.0}},
                {"D": 0.05, "timing": {"fit": 2.0}, "best": "icr"},
                {"D": 0.05, "best": "icr"},
                {"D": 0.06, "best": "icr"},
            )
        )
    ]
    assert len(set(digests[:3])) == 1
    assert digests[3] != digests[0]


@pytest.mark.parametrize("text", ["[1, 2]", '"timing"', "{", "", "[" * 100_000])
def test_a_summary_that_is_no_object_counts_as_it_is(tmp_path, text):
    assert content_digest(written(tmp_path / "summary.json", text)) == sha256(text)


def test_other_files_named_like_json_are_not_parsed(tmp_path):
    text = '{"timing": 1}'
    assert content_digest(written(tmp_path / "laws.json", text)) == sha256(text)


def test_a_file_counts_as_it_was_when_it_was_read_first(tmp_path):
    log = written(tmp_path / "log.csv", "first")
    with recorded(Inputs()) as inputs:
        note_input(log)
        written(log, "second")
        note_input(log)
    note_input(written(tmp_path / "later.csv", "not recorded"))
    assert inputs.digests == {str(log): sha256("first")}


def test_ignored_folders_manifests_and_lost_files_are_no_inputs(tmp_path):
    out = tmp_path / "out"
    with recorded(Inputs([out])) as inputs:
        note_input(written(out / "summary.json", "{}"))
        note_input(written(tmp_path / "manifest.json", "{}"))
        note_input(tmp_path / "missing.csv")
    assert inputs.digests == {}


def test_recordings_within_each_other_note_the_same_file(tmp_path):
    log = written(tmp_path / "log.csv", "content")
    with recorded(Inputs()) as outer, recorded(Inputs()) as inner:
        note_input(log)
    assert outer.digests == inner.digests == {str(log): sha256("content")}
    assert outer.id != inner.id


def test_a_listing_is_that_of_its_names_in_any_order(tmp_path):
    listings = [["b.csv", "a.csv"], ["a.csv", "b.csv"], ["a.csv"]]
    digests = []
    for names in listings:
        with recorded(Inputs()) as inputs:
            note_listing(tmp_path, [Path(name) for name in names])
        digests.append(inputs.digests[str(tmp_path)])
    assert digests[0] == digests[1] == sha256("a.csv\nb.csv")
    assert digests[2] != digests[0]
