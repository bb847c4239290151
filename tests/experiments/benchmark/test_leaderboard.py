"""docs/leaderboard: runs of every row, driven again, have the scores that were submitted."""

import json
from pathlib import Path

import pytest

FOLDER = Path(__file__).parents[3] / "docs" / "leaderboard"
ROWS = [
    pytest.param(
        row, content["suite"], id=f"{file.stem} {row['specification'].partition(':')[0]} {row['compensation']}"
    )
    for file in sorted(FOLDER.glob("*.json"))
    for content in [json.loads(file.read_text(encoding="utf-8"))]
    for row in content["rows"]
]


def driven_again(trackslip, monkeypatch, row, suite, references):
    """Scores [m] by reference and seed of one row's runs."""
    monkeypatch.chdir(FOLDER)
    first = list(row["runs"][references[0]])
    found = trackslip(
        *("benchmark", "--suite", suite, "--controllers", row["specification"], "--gains", "default", "--jobs", "1"),
        *("--compensations", row["compensation"], "--references", *references, "--seeds", *first[:1]),
    )
    return {(case["reference"], str(case["seed"])): case["score"] for case in found.summary["cases"]}


@pytest.mark.slow
@pytest.mark.parametrize(("row", "suite"), ROWS)
def test_a_row_is_what_its_controller_drives(trackslip, monkeypatch, without_figures, row, suite):
    """The first seed of each path."""
    scores = driven_again(trackslip, monkeypatch, row, suite, list(row["runs"]))
    for (reference, seed), score in scores.items():
        assert score == pytest.approx(row["runs"][reference][seed], rel=0.01)


def test_the_leading_row_drives_as_it_says(trackslip, monkeypatch, without_figures):
    row, suite = ROWS[0].values
    scores = driven_again(trackslip, monkeypatch, row, suite, list(row["runs"])[:1])
    ((reference, seed), score) = next(iter(scores.items()))
    assert score == pytest.approx(row["runs"][reference][seed], rel=0.01)
    assert min(one.values[0]["score"] for one in ROWS) == row["score"]


def test_rows_say_what_was_driven():
    for parameter in ROWS:
        row, suite = parameter.values
        assert suite == "fair"
        assert {len(seeds) for seeds in row["runs"].values()} == {8}
        assert len(row["runs"]) == 4
        mean = sum(score for seeds in row["runs"].values() for score in seeds.values()) / 32
        assert row["score"] == pytest.approx(mean)
