import pytest

from experiments.report import terminal as console


def test_a_log_gets_a_line_a_minute(monkeypatch, capsys):
    clock = iter((0.0, 30.0, 30.0, 61.0, 61.0, 61.0, 70.0, 70.0))
    monkeypatch.setattr("experiments.report.terminal.time.monotonic", lambda: next(clock))
    report = console._lines("10 runs", 300.0, "s", 100.0)
    for passed in (20.0, 41.0, 5.0):
        report(passed)
    assert capsys.readouterr().err == "10 runs: 161/300 s, 1 x real time, 0:02:19 left\n"


@pytest.mark.parametrize(("unit", "text"), [("s", "1,234 x real time"), ("steps", "1,234 steps/s")])
def test_rates(unit, text):
    assert console._rate(1234.4, unit) == text


def test_numbers_that_do_not_exist_are_dashes(capsys):
    console.print_table("Slips", ("run", "outer", "inner"), [("nan [m]", f"{float('nan'):+.4f}", "-0.1000")])
    assert capsys.readouterr().out.split()[-4:] == ["nan", "[m]", "-", "-0.1000"]
