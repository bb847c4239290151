"""Numbers as printed."""

import math

import numpy as np
import pytest

from experiments.report.formats import MISSING, number, pair, percent, significant, span


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
