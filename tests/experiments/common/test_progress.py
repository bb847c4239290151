"""What a command tells about its progress where its output is no terminal."""

from experiments.common.progress import progress


def lines_of(capsys, monkeypatch, *arguments, amount):
    monkeypatch.setattr("experiments.common.progress._PAUSE", -1.0)
    with progress(*arguments) as advance:
        advance(amount)
    return capsys.readouterr().err


def test_a_line_says_of_what_the_amount_is_a_part(capsys, monkeypatch):
    line = lines_of(capsys, monkeypatch, "6 runs", 900.0, amount=144.0)
    assert line == "6 runs: 144 of 900 s simulated (16%)\n"


def test_a_stage_of_unknown_length_has_no_total(capsys, monkeypatch):
    assert lines_of(capsys, monkeypatch, "drive", None, "rows", amount=7) == "drive: 7 rows\n"
