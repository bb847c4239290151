"""Calibrations to tables of turns, steady rows and drives, against the candidates that made them."""

from dataclasses import replace

import numpy as np
import pytest

from sim.calibration.calibration import calibrate
from sim.calibration.candidate import PARAMETERS, Candidate
from sim.calibration.targets import Drives, PublishedTurns, SteadyRows, steady_turns
from sim.ground.ground import Ground
from sim.robot.named import load_parameters
from sim.robot.parameters import RobotParameters
from trackslip import se2
from trackslip.errors import InvalidValueError, LogError
from trackslip.identification.samples import SlipSamples
from trackslip.logs.runlog import RunLog
from trackslip.se2 import Mounting
from trackslip.skid_theory import steady_twist

BASE = Candidate()
TRUE = Candidate(
    RobotParameters(half_gauge=0.2, contact_length=0.42, radius_error=-0.012, com_y=0.015), Ground(0.7, 0.91)
)
START = Candidate(replace(TRUE.robot, radius_error=0.0, com_y=0.0), Ground(0.7, 0.7))
FREE = ("friction_ratio", "radius_error", "com_y")
LEFT = np.array([[2.0, 3.0], [3.0, 4.0], [1.0, 3.0], [2.5, 3.0], [1.5, 2.2]])
OMEGA = np.concatenate([LEFT, LEFT[:, ::-1], -LEFT, 0.7 * LEFT])


def theory(robot, ground, omega, **options):
    """Steady twists by quasi-static theory, which is quicker than the simulator."""
    contact = robot.contact_theory(ground.along, ground.across, points=20)
    sides = 1 + robot.radius_error + robot.radius_split * np.array([-1.0, 1.0])
    return steady_twist(omega * robot.sprocket_radius * sides, contact, 9.81, ground.shear)


def rows(candidate, turns=theory, rng=None, noise=0.0, lateral=False):
    """Steady rows of a candidate that turns to both sides, with noise on the tracks' speeds over the faster one's."""
    made = turns(candidate.robot, candidate.ground, OMEGA)
    place = candidate.sensor
    seen = se2.rotate(-place.yaw, made[:, :2] + made[:, 2:] * [-place.y, place.x])
    twist = np.column_stack([seen[:, 0], made[:, 2]])
    if rng is not None:
        speeds = rng.normal(0, noise, OMEGA.shape) * np.abs(OMEGA).max(axis=1, keepdims=True) * 0.06
        b = candidate.robot.half_gauge
        twist = twist + np.stack([speeds.mean(axis=1), (speeds[:, 1] - speeds[:, 0]) / (2 * b)], axis=-1)
    names = [f"{k}" for k in range(len(OMEGA))]
    samples = SlipSamples.of(OMEGA, twist, candidate.geometry, names, lateral=seen[:, 1] if lateral else None)
    return SteadyRows(samples, candidate.geometry, turns=turns)


@pytest.mark.slow
def test_a_known_robot_is_found_again_by_simulation():
    fit = calibrate(rows(TRUE, steady_turns), START, FREE)
    for name in FREE:
        assert fit.estimates[name].held == ""
        assert abs(fit.candidate.value(name) - TRUE.value(name)) < max(3 * fit.estimates[name].stderr, 1e-4)
        assert fit.estimates[name].stderr < 0.002  # the error is the simulator's own


@pytest.mark.slow
def test_intervals_contain_the_truth_as_often_as_they_say():
    """By theory, which is quick."""
    inside, squares = [], []
    for seed in range(40):
        fit = calibrate(rows(TRUE, rng=np.random.default_rng(seed), noise=0.002), START, FREE)
        found = [(fit.estimates[name], TRUE.value(name)) for name in FREE]
        inside += [one.low <= truth <= one.high for one, truth in found]
        squares.append([((one.value - truth) / one.stderr) ** 2 for one, truth in found])
    assert 0.88 <= np.mean(inside) <= 0.99, np.mean(inside)
    assert np.all(np.mean(squares, axis=0) < 2.0), np.mean(squares, axis=0)


@pytest.mark.parametrize("first", [(0.9, -0.05, -0.02), (1.4, 0.05, 0.02)])
def test_other_starts_end_at_the_same_optimum(first):
    """The fit of theory to the paper's turns; the priors move with the start, and hardly matter."""
    fit = calibrate(PublishedTurns(turns=theory), BASE, FREE)
    other = calibrate(PublishedTurns(turns=theory), BASE.with_values(dict(zip(FREE, first, strict=True))), FREE)
    for name in FREE:
        assert abs(other.candidate.value(name) - fit.candidate.value(name)) < 0.5 * fit.estimates[name].stderr
    assert fit.metrics["slip_rms"] < fit.before["slip_rms"]


def test_ratio_and_length_are_told_to_be_one_parameter():
    target = PublishedTurns(turns=theory)
    fit = calibrate(target, BASE, ("friction_ratio", "contact_length", "radius_error"))
    held = {name: one.held for name, one in fit.estimates.items() if one.held}
    assert held == {"contact_length": "the target does not tell it from friction_ratio"}
    assert fit.candidate.robot.contact_length == BASE.robot.contact_length
    assert set(fit.correlation) == {"friction_ratio", "radius_error"}
    alone = calibrate(target, BASE, ("friction_ratio", "radius_error"))
    assert fit.metrics["slip_rms"] == pytest.approx(alone.metrics["slip_rms"], rel=1e-3)


def straight_rows():
    omega = np.array([[2.0, 2.0], [3.0, 3.0], [4.0, 4.0]])
    twist = np.column_stack([0.06 * omega[:, 0], np.zeros(3)])
    return SteadyRows(SlipSamples.of(omega, twist, BASE.geometry, list("abc")), BASE.geometry, turns=theory)


@pytest.mark.parametrize(
    ("name", "target"), [("com_x", PublishedTurns(turns=theory)), ("friction_ratio", straight_rows())]
)
def test_a_parameter_without_effect_is_held(name, target):
    fit = calibrate(target, BASE, (name, "radius_error"))
    assert fit.estimates[name].held == "the target does not tell it"
    assert fit.candidate.value(name) == BASE.value(name)
    assert fit.estimates["radius_error"].held == ""


@pytest.mark.parametrize(
    ("free", "message"),
    [
        (("mass",), "free = 'mass': must be one of half_gauge"),
        (("com_y", "com_y"), "free = 'com_y': must be named once"),
        ((), r"free = \[\]"),
        (("radius_error", "radius_left"), "either radius_error, of both sides, or radius_left and radius_right"),
    ],
)
def test_impossible_calibrations_are_refused(free, message):
    with pytest.raises(InvalidValueError, match=message):
        calibrate(PublishedTurns(), BASE, free)


@pytest.mark.parametrize("name", ["shipped", "husky", "warthog", "maxxii"])
def test_every_parameter_can_be_changed_and_read_back(name):
    base = Candidate(load_parameters(name)[0])
    for parameter, one in PARAMETERS.items():
        for limit in one.limits(base):
            value = one.unscaled(base, limit)
            assert one.low <= value <= one.high  # despite rounding
            changed = base.with_values({parameter: value})
            assert changed.value(parameter) == pytest.approx(value, rel=1e-6, abs=1e-9), parameter
            assert one.scaled(base, value) == pytest.approx(limit, abs=1e-6)


def test_radii_of_both_sides_turn_a_robot_that_drives_straight_on():
    candidate = BASE.with_values({"radius_left": -0.02, "radius_right": 0.02})
    assert candidate.robot.radius_error == pytest.approx(0.0)
    for turns in (theory, steady_turns):
        (twist,) = turns(candidate.robot, candidate.ground, np.array([[3.0, 3.0]]))
        assert twist[0] == pytest.approx(0.18, rel=2e-3)
        assert twist[2] > 0.005


def test_no_weight_brings_a_calibrations_motors_to_their_limits():
    heavy = RobotParameters(mass=400.0, sprocket_radius=0.03)
    found = [turns(heavy, Ground(0.7, 0.77), OMEGA)[:, [0, 2]] for turns in (steady_turns, theory)]
    np.testing.assert_allclose(found[0], found[1], rtol=0.01)


def test_shear_is_found_in_turns_that_theory_drives_with_it():
    truth = replace(BASE, ground=Ground(0.7, 0.805, shear=0.008))
    fit = calibrate(rows(truth), BASE, ("shear", "friction_ratio"))
    assert fit.candidate.value("shear") == pytest.approx(0.008, rel=0.02)
    assert fit.candidate.value("friction_ratio") == pytest.approx(1.15, rel=0.01)
    both = fit.correlation["shear"]["friction_ratio"]
    assert fit.correlation["friction_ratio"]["shear"] == pytest.approx(both, rel=1e-12)
    assert abs(both) < 1


def test_the_place_of_the_sensor_is_found_in_lateral_speeds():
    truth = replace(BASE, sensor=Mounting(0.2, -0.1, 0.03))
    fit = calibrate(rows(truth, lateral=True), BASE, ("sensor_x", "sensor_y", "sensor_yaw", "friction_ratio"))
    for name, value in (("sensor_x", 0.2), ("sensor_y", -0.1), ("sensor_yaw", 0.03)):
        assert fit.candidate.value(name) == pytest.approx(value, abs=2e-3)
    assert set(fit.metrics) == {"v_rms", "w_rms", "lateral_rms", "slip_rms"}


def test_a_missing_lateral_speed_leaves_the_rest_of_its_row():
    target = rows(replace(BASE, sensor=Mounting(0.2, -0.1, 0.03)), lateral=True)
    lateral = target.samples.lateral.copy()
    lateral[4] = np.nan
    part = replace(target, samples=replace(target.samples, lateral=lateral))
    assert len(part.errors(BASE)) == len(target.errors(BASE)) - 1 == len(part.layout.kind)
    found, known = (one.metrics(one.errors(BASE)) for one in (part, target))
    assert found["v_rms"] == known["v_rms"]
    assert found["slip_rms"] == known["slip_rms"]
    assert found["lateral_rms"] != known["lateral_rms"]


def test_single_wrong_rows_hardly_matter():
    target = rows(TRUE)
    twist = target.samples.twist.copy()
    twist[3] *= 2.0
    wrong = replace(target, samples=replace(target.samples, twist=twist))
    fit = calibrate(wrong, START, ("friction_ratio", "radius_error", "com_y"))
    assert fit.candidate.value("friction_ratio") == pytest.approx(TRUE.value("friction_ratio"), rel=0.01)


def test_what_is_held_widens_the_intervals_of_the_others():
    """Only the product of ratio and length matters: the ratio is as uncertain as the prior of the length, 15 %."""
    target = rows(BASE, rng=np.random.default_rng(3), noise=0.002)
    fit = calibrate(target, BASE, ("friction_ratio", "contact_length"))
    alone = calibrate(target, BASE, ("friction_ratio",)).estimates["friction_ratio"]
    assert fit.estimates["contact_length"].held
    found = fit.estimates["friction_ratio"]
    assert found.value == pytest.approx(alone.value, rel=1e-3)
    assert found.stderr == pytest.approx(np.hypot(alone.stderr, 0.15 * alone.value), rel=0.05)


def test_folds_are_predicted_by_fits_to_the_others():
    target = rows(TRUE, rng=np.random.default_rng(0), noise=0.002)
    labels = np.where(target.layout.cluster < 5, 0, np.where(target.layout.cluster < 10, 1, -1))
    fit = calibrate(target, START, FREE, labels)
    assert len(fit.folds) == 2
    for k, fold in enumerate(fit.folds):
        apart = target.samples.take(np.flatnonzero(np.arange(20) // 5 != k))
        alone = calibrate(replace(target, samples=apart), START, FREE)
        for name in FREE:
            assert abs(fold.value(name) - alone.candidate.value(name)) < alone.estimates[name].stderr
    errors = np.full(len(labels), np.nan)
    for k, fold in enumerate(fit.folds):
        errors[labels == k] = target.errors(fold)[labels == k]
    assert fit.held_out == target.metrics(errors)
    assert fit.held_out["w_rms"] < fit.held_out_before["w_rms"] / 3


def drive(time):
    """Along an arc."""
    omega = np.tile([3.0, 4.0], (len(time), 1))
    twist = np.array([0.21, 0.0, 0.06 / 0.336])
    return RunLog("drive", time, omega, se2.exp(time[:, None] * twist))


def test_drives_are_cut_and_compared_at_every_horizon():
    target = Drives([drive(np.arange(0, 20, 0.05))], BASE.geometry)
    assert [round(one.time[-1] - one.time[0]) for one in target.windows] == [6, 6, 6]
    assert target.windows[0].time[0] == 1.5  # what is before is only replayed
    assert set(target.horizon) == {0.5, 1.0, 1.8, 5.0}
    layout = target.layout
    assert layout.clusters == 3
    for cluster in range(3):
        for kind in range(12):
            assert layout.share[(layout.cluster == cluster) & (layout.kind == kind)].sum() == pytest.approx(1.0)


def test_no_window_contains_a_jump_of_the_poses():
    whole = drive(np.arange(0, 20, 0.05))
    jumped = whole.pose + np.where(whole.time[:, None] < 10, 0.0, [3.0, 0.0, 0.0])
    wild = 60
    jumped[wild] += [0.0, 2.0, 1.0]
    target = Drives([replace(whole, pose=jumped)], BASE.geometry)
    assert not any(one.time[0] < 10 < one.time[-1] - 0.05 for one in target.windows)
    seen = np.concatenate([one.time[one.is_valid] for one in target.windows])
    assert whole.time[wild] not in seen
    (left,) = [errors for name, errors in target.metrics(target.errors(BASE)).items() if name == "position_1s_p90"]
    assert left < 0.2


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"pose": np.zeros((100, 3))}, "1 pose while it drives"),
        ({"omega": np.zeros((100, 2))}, "the sprockets stand still"),
    ],
)
def test_drives_without_motion_are_refused(change, message):
    with pytest.raises(LogError, match=message):
        Drives([replace(drive(np.arange(100) * 0.05), **change)], BASE.geometry)


def test_drives_without_headings_are_refused():
    log = drive(np.arange(100) * 0.05)
    bare = np.column_stack([log.pose[:, :2], np.full(100, np.nan)])
    with pytest.raises(LogError, match="no poses with headings"):
        Drives([replace(log, pose=bare)], BASE.geometry)
