"""Doubts of a kind are one line, guesses that contradict each other none, and much that is left out an alarm."""

import pickle
import string

import pytest

from trackslip.doubts import ACCEPTED, KINDS, doubt, in_few_lines, refuse, severity
from trackslip.errors import LogError
from trackslip.logs.runlog import Refused, none_usable


def short(number, poses=8):
    return Refused(f"w{number:03}", f"{poses} poses while it drives, needs at least 10", "short")


def slipping(number, guess):
    return Refused(f"w{number:03}", "slip 0.9 of the faster track is implausible", "slip", guess)


def test_every_kind_has_words_and_every_word_that_insists_a_kind():
    assert {kind.accept for kind in KINDS.values() if kind.accept} == set(ACCEPTED)
    for name, kind in KINDS.items():
        fields = [field for _, field, _, _ in string.Formatter().parse(kind.text) if field is not None]
        assert all(fields), name


def test_one_doubt_keeps_its_line():
    assert in_few_lines([short(5).doubt, "a remark"], 300) == (
        "run 'w005' left out: 8 poses while it drives, needs at least 10 (--accept short insists)",
        "a remark",
    )


def test_many_of_a_kind_are_a_line_with_a_count_and_an_example():
    lines = in_few_lines([*(short(k).doubt for k in range(25)), "a remark", "a remark"], 300)
    assert lines == (
        "25 of 300 runs left out, such as 'w000': 8 poses while it drives, needs at least 10 (--accept short insists)",
        "a remark",
    )
    jumps = [doubt("jump", run, size="1 m", time=2.0, stays="") for run in ("a", "a", "b")]
    assert in_few_lines(jumps, 9) == ("2 of 9 runs (3 times), such as 'a': its pose jumps by 1 m at t = 2 s",)
    assert in_few_lines(jumps[:2], 9) == ("run 'a' (2 times): its pose jumps by 1 m at t = 2 s",)


@pytest.mark.parametrize(
    ("guesses", "runs", "told"),
    [
        (["; rpm"] * 3, 6, True),
        (["; rpm", "; deg/s", "; rpm"], 6, False),  # they contradict each other
        (["; rpm"] * 3, 300, False),  # the others are plausible: these slide
        (["; rpm"], 2, True),
    ],
)
def test_guesses_are_told_only_where_the_runs_agree(guesses, runs, told):
    lines = in_few_lines([slipping(k, guess).doubt for k, guess in enumerate(guesses)], runs)
    assert ("; rpm" in " ".join(lines)) == told
    assert "deg/s" not in " ".join(lines)


def test_more_than_a_tenth_left_out_is_an_alarm_at_the_top():
    lines = in_few_lines(["a remark", *(short(k).doubt for k in range(30))], 300)
    assert [severity(line) for line in lines] == ["doubt", "doubt"]
    lines = in_few_lines(["a remark", *(short(k).doubt for k in range(31))], 300)
    assert lines[0] == "31 of 300 runs left out (10 %), so the laws hold for the rest alone: see the warnings"
    assert severity(lines[0]) == "alarm"
    still = [Refused(f"w{k}", "the sprockets stand still", "still").doubt for k in range(200)]
    assert severity(in_few_lines(still, 300)[0]) == "doubt"


def test_a_user_insists():
    with pytest.raises(LogError, match="run 'a': 3 poses while it drives, needs at least 10"):
        refuse("short", ("units",), "a", poses="3 poses", least=10)
    refuse("short", ("units", "short"), "a", poses="3 poses", least=10)


def test_a_refusal_keeps_its_kind_and_a_pickle_its_severity():
    with pytest.raises(LogError) as caught:
        refuse("headings", (), "a", ", but do in degrees")
    refused = Refused.of("a", caught.value)
    assert refused == Refused("a", "column phi: headings don't fit the path", "headings", ", but do in degrees")
    assert str(refused).startswith("run 'a' left out: column phi: headings don't fit the path, but do in degrees")
    assert severity(pickle.loads(pickle.dumps(doubt("little", what="nothing")))) == "alarm"


def test_a_log_without_any_usable_run_says_the_most_frequent_reason():
    line = none_usable([slipping(0, "; rpm"), *(short(k) for k in range(1, 5))])
    assert line == (
        "none of the 5 runs can be used; 4 of 5 runs left out, such as 'w001': 8 poses while it drives, needs at least "
        "10 (--accept short insists)"
    )
