"""Numbers as printed."""

import math

import numpy as np
import pytest

from experiments.report.formats import MISSING, number, pair, percent, significant, span
from experiments.report.terminal import progress_line


@pytest.mark.parametrize("value", [None, math.nan, math.inf])
def test_what_does_not_exist_is_a_dash(value):
    assert number(value, 2, "mm") == significant(value, "mm") == MISSING


def test_numbers():
    assert number(-1.256, 2, "mm") == "−1.26 mm"
    assert number(1412.34, 1) == "1412.3"
    assert [significant(value) for value in (0.0, 0.00123, 4.56, 12345.6)] == ["0", "0.0012", "4.6", "12,346"]
    assert percent(0.0123) == "1.2 %"
    assert percent(None) == MISSING


def test_several_values():
    assert pair(["1.0", "2.0"], "mm") == "1.0 | 2.0 mm"
    assert pair([MISSING], "mm") == MISSING
    assert span(np.array([0.5, 2.5]), "m") == "0.5 to 2.5 m"
    assert span(np.array([10.0, 10.0]), "°") == "10°"


def test_a_line_of_progress_says_how_far_it_is_and_how_long_it_takes():
    assert progress_line(161.0, 300.0, "s", 100.0, 61.0) == "161/300 s, 1 x real time, 0:02:19 left"
    assert progress_line(5.0, 10.0, "fits", 0.0, 10.0) == "5/10 fits, 0:00:10 left"
    assert progress_line(100.0, 300.0, "s", 100.0, 61.0) == "100/300 s"
