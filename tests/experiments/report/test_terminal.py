import io
import sys
import time

import pytest

from experiments.report import terminal as console


def test_a_line_says_how_far_it_is_and_how_long_it_takes():
    assert console.progress_line(161.0, 300.0, "s", 100.0, 61.0) == "161/300 s, 1 x real time, 0:02:19 left"
    assert console.progress_line(5.0, 10.0, "fits", 0.0, 10.0) == "5/10 fits, 0:00:10 left"
    assert console.progress_line(100.0, 300.0, "s", 100.0, 61.0) == "100/300 s"


def test_a_log_gets_a_line_once_a_command_takes_long(monkeypatch, capsys):
    """Whether it reports progress or not; a quick one prints nothing."""
    with console.progress("quick", 10.0) as advance:
        advance(10.0)
    assert capsys.readouterr().err == ""
    monkeypatch.setattr(console, "_FIRST_LINE", 0.01)
    monkeypatch.setattr(sys, "stderr", slow := io.StringIO())
    with console.progress("slow", 10.0) as advance:
        advance(4.0)
        wait_for(slow)
    assert slow.getvalue().startswith("slow: 4/10 s, ")
    monkeypatch.setattr(sys, "stderr", laws := io.StringIO())
    with console.busy("laws"):
        wait_for(laws)
    assert laws.getvalue() == "laws: 0 s\n"


def wait_for(lines):
    """Wait until something is written; capsys may lose what is written while it is read."""
    while not lines.getvalue().endswith("\n"):
        time.sleep(0.01)


@pytest.mark.parametrize(("unit", "text"), [("s", "1,234 x real time"), ("steps", "1,234 steps/s")])
def test_rates(unit, text):
    assert console.rate_text(1234.4, unit) == text
