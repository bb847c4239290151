import json
from dataclasses import replace

import numpy as np
import pytest
from law_motion import LawMotion, SlipVariation

from trackslip.errors import TrackslipError
from trackslip.identification.law_fit import fit_drives
from trackslip.identification.path import DriveModel
from trackslip.kinematics import RobotGeometry
from trackslip.laws.families import FAMILIES
from trackslip.laws.icr import ConstantIcr
from trackslip.odometry.uncertainty import LawErrors
from trackslip.planning import plan as planning
from trackslip.planning.information import PoseQuality, drive_to_measure, expected
from trackslip.planning.limits import DriveLimits, first_knowledge, read_identification
from trackslip.planning.plan import PLANNED_LAWS, plan_drive
from trackslip.planning.route import RATE, path

GEOMETRY = RobotGeometry(0.168, 0.06)
LIMITS = DriveLimits(max_speed=0.3, acceleration=0.5, area=(3.0, 3.0), duration=40.0)
SLAM = PoseQuality(10.0, 0.02, np.radians(1.0))


@pytest.fixture(scope="module", autouse=True)
def few_drives_tried():
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(planning, "MAX_EVALUATIONS", 40)
        patch.setattr(planning, "MIN_EVALUATIONS", 40)
        yield


@pytest.fixture(scope="module")
def plan():
    return plan_drive(GEOMETRY, LIMITS, SLAM)


def test_it_keeps_to_area_and_limits_and_turns_to_both_sides(plan):
    x, y = path(plan.maneuvers, float(plan.start[2]), plan.knowledge.extremes)
    at = plan.start[:2, None, None] + np.stack([x, y])
    assert np.abs(at).max() < 1.5
    assert np.abs(plan.speeds).max() <= 0.3 + 1e-9
    acceleration = np.diff(plan.speeds, axis=0) * RATE
    assert np.abs(acceleration).max() <= 0.5 + 1e-6
    assert plan.time[-1] == pytest.approx(40.0)
    np.testing.assert_array_equal(plan.speeds[-1], 0.0)
    np.testing.assert_allclose(plan.omega, plan.speeds / 0.06)
    assert (np.ptp(plan.places, axis=0) <= [3.0, 3.0]).all()
    w = plan.twist[:, 1]
    assert w.max() > 0.5
    assert w.min() < -0.5
    assert abs(plan.twist[:, 0]).max() > 0.29


def test_longer_drives_tell_more_and_smaller_areas_less(plan):
    again = plan_drive(GEOMETRY, LIMITS, SLAM)
    np.testing.assert_array_equal(again.speeds, plan.speeds)
    longer = plan_drive(GEOMETRY, replace(LIMITS, duration=80.0), SLAM)
    smaller = plan_drive(GEOMETRY, replace(LIMITS, area=(1.0, 1.0)), SLAM)

    def largest_error(plan_made):
        return planning.largest(plan_made.expectation, plan.sizes)

    assert largest_error(longer) < 0.8 * largest_error(plan)
    assert largest_error(smaller) > 1.1 * largest_error(plan)


def test_a_second_round_is_made_for_what_is_left_open(plan, monkeypatch):
    monkeypatch.setattr(planning, "MAX_EVALUATIONS", 80)
    known = LawErrors(("offset", "radius_error"), np.diag(np.square([1e-3, 1e-4])))
    second = plan_drive(GEOMETRY, LIMITS, SLAM, known=known)
    model = DriveModel(FAMILIES["icr_radius"], GEOMETRY)
    drive = drive_to_measure(plan.maneuvers.speeds(40.0), RATE, SLAM, 0.06)
    first = expected(model, plan.values, [drive], SLAM, plan.knowledge.slip, known)
    error_of_first = planning.largest(first, plan.sizes)
    error_of_second = planning.largest(second.expectation, plan.sizes)
    assert error_of_second < 0.95 * error_of_first
    assert second.expectation.stderr["offset"] < first.stderr["offset"]  # which is left open


def test_laws_of_more_parameters_can_be_planned_for(monkeypatch):
    monkeypatch.setattr(planning, "MAX_EVALUATIONS", 60)  # few drives determine a loss in turns
    found = plan_drive(GEOMETRY, LIMITS, SLAM, PLANNED_LAWS[-1])
    for name, size in found.sizes.items():
        assert 0 < found.expectation.stderr[name] < 0.04 * size


STDERR = {"offset": 2e-4, "radius_error": 9e-4, "sensor_x": 1e-3}
CORRELATION = [[1.0, 0.5, 0.1], [0.5, 1.0, 0.0], [0.1, 0.0, 1.0]]
LAW = {
    "values": {"offset": 0.045, "radius_error": 0.006},
    "stderr": STDERR,
    "interval95": {"offset": [0.0441, 0.0459]},
    "correlation": CORRELATION,
    "extras": dict.fromkeys(
        ("sensor_x", "sensor_y", "sensor_yaw", "drift", "clock_offset", "lag"), 0.0
    ),
    "noise": {
        "position": 0.02,
        "heading": 0.01,
        "slip_forward": 0.003,
        "slip_sideways": 1e-9,
        "slip_turn": 0.004,
    },
}
ICR = {"values": {"offset": 0.044}, "stderr": {"offset": 1e-3}}


def summary(**changes):
    """What an identification by whole drives stores, with changes to what it says of icr_radius."""
    law = {**LAW, **changes}
    return {
        "format": 1,
        "method": "drive",
        "geometry": {"half_gauge": 0.168, "sprocket_radius": 0.06},
        "slip_laws": {
            "icr": ICR,
            "icr_radius": {key: law[key] for key in ("values", "stderr", "interval95")},
        },
        "drive": {
            "best": "icr_radius",
            "laws": {"icr_radius": law, "none": {"values": {}, "stderr": {}}},
        },
    }


def written(folder, content):
    (folder / "summary.json").write_text(json.dumps(content))
    return folder


def test_law_noise_and_covariance(tmp_path):
    before, knowledge = read_identification(written(tmp_path, summary()), "icr_radius")
    assert before.law == ConstantIcr(0.045, 0.168, 0.006)
    assert before.errors.names == ("offset", "radius_error")
    # the interval is wider than the model's standard error says
    offset_error = 0.0018 / 2 / 1.959964
    radius_error = 9e-4
    both = 0.5 * offset_error * radius_error
    expected = np.array([[offset_error**2, both], [both, radius_error**2]])
    np.testing.assert_allclose(before.errors.covariance, expected, rtol=1e-6)
    assert knowledge.slip == (0.003, 1e-4, 0.004)
    assert knowledge.offset == 0.045
    assert knowledge.reach_doubt == pytest.approx(0.01)
    assert before.geometry.half_gauge == 0.168


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ({}, "no slip laws in it"),
        (summary() | {"geometry": {"half_gauge": -1, "sprocket_radius": 1}}, "half_gauge = -1"),
        (
            summary() | {"slip_laws": {"icr": ICR}},
            "law = 'icr_radius': must be one of none, icr (in ",
        ),
        (summary(stderr={}), "no standard errors of the law icr_radius in it"),
        (summary(values={"offset": 0.04}), "radius_error = None: must be a number"),
        (summary(correlation=[[1, 2, 0], [2, 1, 0], [0, 0, 1]]), "is damaged (covariance"),
        (summary(noise={"slip_turn": 1.0}), "is damaged (noise"),
    ],
)
def test_summaries_that_cannot_be_used(tmp_path, content, message):
    with pytest.raises(TrackslipError) as refused:
        read_identification(written(tmp_path, content), "icr_radius")
    assert message in str(refused.value)


def test_limits_that_allow_no_drive_are_refused():
    slow = replace(LIMITS, max_speed=1e-3, duration=10.0)
    said = r"duration = 10\.0: must be longer, for a drive within the limits"
    with pytest.raises(TrackslipError, match=said):
        plan_drive(GEOMETRY, slow, SLAM)
    slippery = replace(first_knowledge(GEOMETRY), slip=(0.5, 0.5, 0.5))
    with pytest.raises(TrackslipError, match="area = '3x3': must be larger"):
        plan_drive(GEOMETRY, LIMITS, SLAM, knowledge=slippery)


MODEL = DriveModel(FAMILIES["icr_radius"], GEOMETRY)
TRUTH = np.array([0.045, 0.0066])
SLIP = (0.002, 0.002, 0.005)
COARSE = PoseQuality(10.0, 0.02, np.radians(1.0))
READINGS = 20.0  # of the encoders [Hz]
TIME = np.arange(400) / READINGS
SPEEDS = np.column_stack([0.2 + 0.1 * np.sin(0.7 * TIME), 0.2 * np.cos(0.5 * TIME)])


@pytest.mark.parametrize("poses", [COARSE, PoseQuality(5.0, 0.02, None)])
def test_fits_miss_the_law_by_about_what_is_expected(poses):
    """Drives of two minutes with slip that varies and noisy poses; `validation/test_plan_trials.py`
    has hundreds.
    """
    speeds = np.tile(SPEEDS, (6, 1))
    drive = drive_to_measure(speeds, READINGS, poses, 0.06)
    stated = expected(MODEL, TRUTH, [drive], poses, SLIP).stderr
    law = FAMILIES["icr_radius"].law(TRUTH, GEOMETRY)
    robot = LawMotion(law, GEOMETRY, SlipVariation(*SLIP))
    omega = np.concatenate([speeds[:1], speeds]) / 0.06
    pose_noise = [poses.position, poses.position, poses.heading or np.nan]
    missed = []
    for seed in range(10):
        rng = np.random.default_rng(seed)
        motion, _ = robot.drive(omega, READINGS, rng)
        noise = rng.normal(size=drive.pose.shape) * pose_noise
        driven = replace(drive, pose=motion.at(drive.time) + noise)
        fit = fit_drives("icr_radius", [driven], GEOMETRY)
        assert tuple(fit.values) == ("offset", "radius_error")
        errors = np.array(list(fit.values.values())) - TRUTH
        missed.append(errors / [stated["offset"], stated["radius_error"]])
    ratio = np.sqrt(np.mean(np.square(missed), axis=0))
    assert ((ratio > 0.55) & (ratio < 1.5)).all()  # within two standard errors


def test_what_the_driving_does_not_tell_is_held():
    straight = drive_to_measure(np.full((400, 2), 0.3), READINGS, COARSE, 0.06)
    found = expected(MODEL, TRUTH, [straight], COARSE, SLIP)
    assert "offset" in found.undetermined
    assert "radius_error" in found.stderr
    without_headings = PoseQuality(5.0, 0.05, None)
    drive = drive_to_measure(SPEEDS, READINGS, without_headings, 0.06)
    found = expected(MODEL, TRUTH, [drive], without_headings, SLIP)
    assert "sensor_yaw" in found.undetermined


def test_information_from_before_adds_up():
    """Twice the same drive, or one and what is known of the law from the other: the extras of the
    first are its own.
    """
    drive = drive_to_measure(SPEEDS, READINGS, COARSE, 0.06)
    alone = expected(MODEL, TRUTH, [drive], COARSE, SLIP)
    covariance = np.diag([alone.stderr["offset"] ** 2, alone.stderr["radius_error"] ** 2])
    known = LawErrors(("offset", "radius_error"), covariance)
    both = expected(MODEL, TRUTH, [drive], COARSE, SLIP, known)
    for name in known.names:
        assert 0.5 * alone.stderr[name] < both.stderr[name] < 0.8 * alone.stderr[name]
    certain = LawErrors(("offset", "radius_error"), 1e-12 * np.eye(2))
    found = expected(MODEL, TRUTH, [drive], COARSE, SLIP, certain)
    assert found.stderr["offset"] < 1.1e-6
