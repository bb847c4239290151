import importlib
import math
import pkgutil

import pytest

from experiments.measuring.check import Check, at_least
from experiments.speed import pipeline
from experiments.speed.pipeline.areas import AREAS


def test_no_area_is_left_out():
    there = {found.name for found in pkgutil.iter_modules(pipeline.__path__)} - {"areas"}
    assert set(AREAS) == there


def test_checks_are_printed_and_stored(trackslip, monkeypatch):
    seen = []

    def measure_of(area):
        def measure(seed, repeats, step):
            seen.append((area, seed, repeats))
            step("round 1")
            over, under = Check(area, "time over physics", 2.5, 2.0, "x"), Check(area, "speed", 0.6, at_least(0.5), "x")
            return over, under

        return measure

    areas = importlib.import_module("experiments.speed.pipeline.areas")
    monkeypatch.setattr(areas, "AREAS", ("laws", "report"))
    monkeypatch.setattr(areas, "measure_of", measure_of)
    result = trackslip("bench", "--pipeline", "--seed", "4", "--repeats", "2")
    assert seen == [("laws", 4, 2), ("report", 4, 2)]
    slow, fast = result.summary["checks"][:2]
    assert slow == {"name": "laws: time over physics", "value": 2.5, "bound": 2.0, "unit": "x", "holds": False}
    assert (fast["bound"], fast["holds"]) == ([0.5, None], True)
    assert "at most 2" in result.printed
    assert "at least 0.5" in result.printed
    assert "does not hold" in result.printed


@pytest.mark.parametrize(("value", "holds"), [(0.4, False), (0.5, True), (9.0, True), (math.nan, False)])
def test_a_value_must_not_be_smaller_than_its_bound(value, holds):
    assert Check("", "", value, at_least(0.5), "1").holds == holds
