"""Planned drives: in the area whatever the law, within the limits, the better the longer; and what can't be planned."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from trackslip.errors import InvalidValueError
from trackslip.identification.path import DriveModel
from trackslip.kinematics import RobotGeometry
from trackslip.laws.families import FAMILIES
from trackslip.odometry.uncertainty import LawErrors
from trackslip.planning import plan as planning
from trackslip.planning.information import PoseQuality, drive_to_measure, expected
from trackslip.planning.limits import DriveLimits, first_knowledge
from trackslip.planning.plan import PLANNED_LAWS, plan_drive
from trackslip.planning.route import RATE, path

GEOMETRY = RobotGeometry(0.168, 0.06)
LIMITS = DriveLimits(max_speed=0.3, acceleration=0.5, area=(3.0, 3.0), duration=40.0)
SLAM = PoseQuality(10.0, 0.02, np.radians(1.0))


@pytest.fixture(scope="module", autouse=True)
def few_drives_tried():
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(planning, "_EVALUATIONS", 40)
        patch.setattr(planning, "_FEWEST", 40)
        yield


@pytest.fixture(scope="module")
def plan():
    return plan_drive(GEOMETRY, LIMITS, SLAM)


def test_it_keeps_to_area_and_limits_and_turns_to_both_sides(plan):
    x, y = path(plan.maneuvers, float(plan.start[2]), plan.knowledge.extremes)
    at = plan.start[:2, None, None] + np.stack([x, y])
    assert np.abs(at).max() < 1.5
    assert np.abs(plan.speeds).max() <= 0.3 + 1e-9
    assert np.abs(np.diff(plan.speeds, axis=0)).max() * RATE <= 0.5 + 1e-6
    assert plan.time[-1] == pytest.approx(40.0)
    np.testing.assert_array_equal(plan.speeds[-1], 0.0)
    np.testing.assert_allclose(plan.omega, plan.speeds / 0.06)
    assert (np.ptp(plan.places, axis=0) <= [3.0, 3.0]).all()
    w = plan.twist[:, 1]
    assert w.max() > 0.5
    assert w.min() < -0.5
    assert abs(plan.twist[:, 0]).max() > 0.29


def test_plans_repeat_longer_drives_tell_more_and_smaller_areas_less(plan):
    again = plan_drive(GEOMETRY, LIMITS, SLAM)
    np.testing.assert_array_equal(again.speeds, plan.speeds)
    longer = plan_drive(GEOMETRY, replace(LIMITS, duration=80.0), SLAM)
    smaller = plan_drive(GEOMETRY, replace(LIMITS, area=(1.0, 1.0)), SLAM)
    best, other, worst = (planning.largest(one.expectation, plan.sizes) for one in (longer, plan, smaller))
    assert best < 0.8 * other
    assert worst > 1.1 * other


def test_a_second_round_is_made_for_what_is_left_open(plan, monkeypatch):
    monkeypatch.setattr(planning, "_EVALUATIONS", 120)
    known = LawErrors(("offset", "radius_error"), np.diag(np.square([1e-3, 1e-4])))
    second = plan_drive(GEOMETRY, LIMITS, SLAM, known=known)
    model = DriveModel(FAMILIES["icr_radius"], GEOMETRY)
    drive = drive_to_measure(plan.maneuvers.speeds(40.0), RATE, SLAM, 0.06)
    first = expected(model, plan.values, [drive], SLAM, plan.knowledge.slip, known)
    assert planning.largest(second.expectation, plan.sizes) < 0.95 * planning.largest(first, plan.sizes)
    assert second.expectation.stderr["offset"] < first.stderr["offset"]  # which is left open


@pytest.mark.parametrize("law", PLANNED_LAWS[1:])  # icr_radius is planned for above
def test_every_law_can_be_planned_for(law, monkeypatch):
    monkeypatch.setattr(planning, "_EVALUATIONS", 100)  # few drives determine a loss in turns
    found = plan_drive(GEOMETRY, LIMITS, SLAM, law)
    assert all(0 < found.expectation.stderr[name] < 0.04 * size for name, size in found.sizes.items())


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"max_speed": 0.0}, "max_speed = 0.0: must be from 0.001 to 10 m/s"),
        ({"duration": 5.0}, "duration = 5.0: must be from 10 to 3600 s"),
        ({"area": (3.0, 3.0), "clearance": 1.5}, "area = '3x3': must be more than twice the clearance, 1.5 m"),
    ],
)
def test_limits_that_cannot_be(changes, message):
    with pytest.raises(InvalidValueError) as refused:
        replace(LIMITS, **changes)
    assert message in str(refused.value)


@pytest.mark.parametrize(
    ("changes", "options", "message"),
    [
        ({"area": (3.0, 0.6)}, {}, "area = '3x0.6': must be more than 0.672 m long and wide, for the robot to turn"),
        ({"max_speed": 1e-3, "duration": 10.0}, {}, "duration = 10.0: must be longer, for a drive within the limits"),
        ({}, {"knowledge": replace(first_knowledge(GEOMETRY), slip=(0.5,) * 3)}, "area = '3x3': must be larger"),
        ({}, {"law": "none"}, "law = 'none': must be one of icr_radius, turn_loss"),
    ],
)
def test_drives_that_cannot_be(changes, options, message):
    with pytest.raises(InvalidValueError) as refused:
        plan_drive(GEOMETRY, replace(LIMITS, **changes), SLAM, **options)
    assert message in str(refused.value)
