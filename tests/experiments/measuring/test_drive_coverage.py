"""What the drive estimator has to reach: the cases' logs, the checks, and the study around them."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from experiments.measuring import drive_coverage, drive_study
from experiments.measuring.check import Check
from experiments.measuring.drive_cases import CASES, SIMULATED, TRUE_LAW, Case
from experiments.measuring.drive_coverage import Estimate, Repeat, Task, checks_of, repeat
from experiments.parallel.executors import InlineExecutor, Workers
from trackslip.errors import LogError
from trackslip.kinematics import RobotGeometry
from trackslip.logs.runlog import RunLog

GEOMETRY = RobotGeometry(0.168, 0.06)
NORMAL = 1.959964
CASE = Case(
    "a case",
    CASES[0].source,
    rms={"offset": 0.00112},
    covered=("offset",),
    over_model=1.5,
    standard_errors=5.0,
)
"""Errors of 1 mm are allowed 12 % of room, five standard errors of the rms of 1000 repeats."""
EXACT = Estimate(TRUE_LAW["radius_error"], 0.001, 0.0, 1.0)


def repeats(bias: float = 0.0, stderr: float = 0.001, count: int = 1000) -> list[Repeat]:
    """Estimates of D with errors of 1 mm."""
    found = []
    for number, error in enumerate(np.random.default_rng(0).normal(bias, 0.001, count)):
        value = TRUE_LAW["offset"] + error
        estimate = Estimate(value, stderr, value - NORMAL * stderr, value + NORMAL * stderr)
        found.append(Repeat(Task(0, number, 0, GEOMETRY), {"offset": estimate, "radius_error": EXACT}, {}))
    return found


def holding(checks: list[Check]) -> dict[str, bool]:
    return {check.what: check.holds for check in checks}


def test_honest_estimates_hold():
    checks = checks_of(CASE, repeats())
    assert all(check.holds for check in checks)
    by_name = {check.what: check.value for check in checks}
    assert by_name["rms error of offset"] == pytest.approx(0.001, rel=0.1)
    assert by_name["coverage of offset"] == pytest.approx(0.95, abs=0.02)
    assert by_name["half width of offset over the model's"] == pytest.approx(1.0)


@pytest.mark.parametrize(
    ("found", "broken"),
    [
        (repeats(bias=0.001), {"rms error of offset", "coverage of offset"}),
        (repeats(stderr=0.0003), {"coverage of offset", "largest error of offset in standard errors"}),
        (repeats(stderr=0.01), {"coverage of offset"}),
        ([*repeats()[1:], replace(repeats()[0], estimates={}, failure="why")], {"fits without D or epsilon"}),
        ([*repeats()[1:], replace(repeats()[0], estimates={"offset": EXACT})], {"fits without D or epsilon"}),
        ([replace(one, estimates={}, failure="why") for one in repeats(count=3)], "all"),
    ],
)
def test_dishonest_ones_do_not(found, broken):
    held = holding(checks_of(CASE, found))
    assert {what for what, holds in held.items() if not holds} == (set(held) if broken == "all" else broken)


def test_wide_intervals_are_found():
    wide = [
        replace(one, estimates=one.estimates | {"offset": replace(one.estimates["offset"], low=0.0, high=1.0)})
        for one in repeats()
    ]
    assert not holding(checks_of(CASE, wide))["half width of offset over the model's"]


def test_the_cramer_rao_bound_is_the_measure_where_it_is_asked_for():
    case = replace(CASE, rms={}, over_bound=1.15)
    for bound, holds in ((0.001, True), (0.0008, False)):
        both = {"offset": bound, "radius_error": bound}
        found = holding(checks_of(case, [replace(one, bound=both) for one in repeats()]))
        assert found["rms error of offset"] == holds


def test_checks_are_stored_with_what_they_say():
    check = Check("case", "rms error of offset", 0.001, (0.0, 0.002), "m")
    assert check.to_json() == {
        "name": "case: rms error of offset",
        "value": 0.001,
        "bound": (0.0, 0.002),
        "unit": "m",
        "holds": True,
    }
    assert not replace(check, value=float("nan")).holds


def truthful(name: str, logs: list[RunLog], geometry: RobotGeometry) -> SimpleNamespace:
    """Instead of a fit: the truth of the case with everything, with small errors that tell the log."""
    shift = 1e-6 * float(np.nanmean(logs[0].pose[logs[0].is_valid, 0]) % 1)
    values = {key: value + shift for key, value in TRUE_LAW.items()}
    extras = {"sensor_x": 0.3, "sensor_y": 0.1, "sensor_yaw": np.radians(5.0), "clock_offset": -0.15}
    both = values | extras
    return SimpleNamespace(
        values=values,
        extras=extras,
        stderr=dict.fromkeys(both, 1e-5),
        interval95={key: (value - 2e-5, value + 2e-5) for key, value in both.items()},
    )


@pytest.fixture
def quick(monkeypatch):
    monkeypatch.setattr(drive_coverage, "DURATION", 30.0)
    monkeypatch.setattr(drive_study, "DURATION", 30.0)
    monkeypatch.setattr(drive_coverage, "fit_drives", truthful)


@pytest.mark.usefixtures("quick")
def test_repeats_are_the_same_for_the_same_seed_and_number():
    one, same, other, third = (
        repeat(Task(0, number, seed, GEOMETRY)).estimates["offset"].value
        for number, seed in ((0, 0), (0, 0), (1, 0), (0, 1))
    )
    assert one == same
    assert len({one, other, third}) == 3


@pytest.mark.usefixtures("quick")
def test_a_study_takes_every_case_and_every_drive(robot):
    drives = drive_study.simulated_drives(robot, 2, 0, 1, lambda _: None)
    steps: list[float] = []
    law = {"offset": 0.045, "radius_error": 0.0066}
    pool = Workers(InlineExecutor(), 1)
    found = drive_study.study(drives, (law, law), robot.geometry, 3, 0, pool, steps.append)
    assert len(steps) == drive_study.size(2, 3) == 2 + 3 * len(CASES)
    assert {check.case for check in found.checks} == {case.name for case in CASES}
    simulated = [check for check in found.checks if check.case == SIMULATED.name]
    assert {check.what for check in simulated} >= {"rms error of offset", "coverage of radius_error"}
    assert found.failures == []
    assert found.simulated.drives == 2
    assert found.simulated.mean["offset"] == pytest.approx(0.045, abs=1e-5)


def test_a_fit_that_fails_is_recorded(monkeypatch):
    def failing(*_: object) -> None:
        raise LogError("the drives don't determine offset")

    monkeypatch.setattr(drive_coverage, "DURATION", 30.0)
    monkeypatch.setattr(drive_coverage, "fit_drives", failing)
    found = repeat(Task(0, 0, 0, GEOMETRY))
    assert found.failure == "the drives don't determine offset"
    assert set(found.bound) == {"offset", "radius_error"}


def test_steady_circles_of_the_same_speeds_have_icrs_farther_out(robot, monkeypatch):
    """The tracks slip faster at a higher yaw rate, and the simulated friction grows a little with the speed of slip."""
    monkeypatch.setattr(drive_study, "_CIRCLES", 5.0)
    same, paper = drive_study.steady_laws(robot, 1)
    assert 0.044 < paper["offset"] < same["offset"] < 0.047
    assert paper["radius_error"] == pytest.approx(0.0066, abs=5e-4)
