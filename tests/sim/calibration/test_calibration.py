"""Calibrations to tables of turns, steady rows and drives, against the candidates that made them."""

from dataclasses import replace

import numpy as np
import pytest
from simulated_drives import drawn, driven

from sim import Ground, RobotParameters
from sim.calibration.calibration import calibrate
from sim.calibration.candidate import PARAMETERS, Candidate
from sim.calibration.targets import Drives, PublishedTurns, SteadyRows
from sim.robot.named import load_parameters
from trackslip import se2
from trackslip.errors import InvalidValueError, LogError
from trackslip.identification.samples import SlipSamples
from trackslip.logs.runlog import RunLog
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


def rows(candidate, rng=None, noise=0.0, lateral=False):
    """Steady rows of a candidate that turns to both sides, with noise on the tracks' speeds over the faster one's."""
    turns = theory(candidate.robot, candidate.ground, OMEGA)
    place = candidate.sensor
    seen = se2.rotate(-place.yaw, turns[:, :2] + turns[:, 2:] * [-place.y, place.x])
    twist = np.column_stack([seen[:, 0], turns[:, 2]])
    if rng is not None:
        speeds = rng.normal(0, noise, OMEGA.shape) * np.abs(OMEGA).max(axis=1, keepdims=True) * 0.06
        b = candidate.robot.half_gauge
        twist = twist + np.stack([speeds.mean(axis=1), (speeds[:, 1] - speeds[:, 0]) / (2 * b)], axis=-1)
    names = [f"{k}" for k in range(len(OMEGA))]
    samples = SlipSamples.of(OMEGA, twist, candidate.geometry, names, lateral=seen[:, 1] if lateral else None)
    return SteadyRows(samples, candidate.geometry, turns=theory)


@pytest.mark.slow
def test_intervals_contain_the_truth_as_often_as_they_say():
    """By theory, which is quick."""
    inside, squares = [], []
    for seed in range(40):
        fit = calibrate(rows(TRUE, rng=np.random.default_rng(seed), noise=0.002), START, FREE)
        pairs = [(fit.estimates[name], TRUE.value(name)) for name in FREE]
        inside += [estimate.low <= truth <= estimate.high for estimate, truth in pairs]
        squares.append([((estimate.value - truth) / estimate.stderr) ** 2 for estimate, truth in pairs])
    assert 0.88 <= np.mean(inside) <= 0.99, np.mean(inside)
    assert np.all(np.mean(squares, axis=0) < 2.0), np.mean(squares, axis=0)


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


def test_parameters_can_be_changed_and_read_back():
    for name, parameter in PARAMETERS.items():
        for limit in parameter.limits(BASE):
            value = parameter.unscaled(BASE, limit)
            assert parameter.low <= value <= parameter.high  # despite rounding
            assert BASE.with_values({name: value}).value(name) == pytest.approx(value, rel=1e-6, abs=1e-9)
            assert parameter.scaled(BASE, value) == pytest.approx(limit, abs=1e-6)


@pytest.mark.parametrize(
    ("truth", "wrong"),
    [
        ({"friction_ratio": 1.3, "radius_error": -0.012, "com_y": 0.015}, 2.0),
        ({"shear": 0.008, "friction_ratio": 1.15}, 1.0),
        ({"sensor_x": 0.2, "sensor_y": -0.1, "sensor_yaw": 0.03, "radius_left": -0.02, "radius_right": 0.01}, 1.0),
    ],
)
def test_parameters_are_found_again_in_steady_rows_although_one_is_wrong(truth, wrong):
    target = rows(BASE.with_values(truth), lateral="sensor_x" in truth)
    target.samples.twist[3] *= wrong
    fit = calibrate(target, BASE, tuple(truth))
    for name, value in truth.items():
        assert fit.candidate.value(name) == pytest.approx(value, rel=0.01, abs=1e-3), name
    matrix = [[1.0 if a == b else fit.correlation[a][b] for a in truth] for b in truth]
    assert np.linalg.eigvalsh(matrix).min() > 0
    assert ("lateral_rms" in fit.metrics) == ("sensor_x" in truth)


def test_what_is_not_told_widens_the_intervals_of_the_others():
    """Only the product of ratio and length matters: their priors, 30 and 15 %, leave 13 % of the ratio unknown."""
    target = rows(BASE, rng=np.random.default_rng(3), noise=0.002)
    fit = calibrate(target, BASE, ("friction_ratio", "contact_length", "radius_error"))
    vague = {name: estimate.vague for name, estimate in fit.estimates.items() if estimate.vague}
    assert vague == {"contact_length": "the target does not tell it from friction_ratio"}
    assert fit.candidate.robot.contact_length == pytest.approx(BASE.robot.contact_length, rel=0.01)
    alone = calibrate(target, BASE, ("friction_ratio", "radius_error")).estimates["friction_ratio"]
    ratio = fit.estimates["friction_ratio"]
    assert ratio.value == pytest.approx(alone.value, rel=0.01)
    assert ratio.stderr == pytest.approx(0.3 * 0.15 / np.hypot(0.3, 0.15) * alone.value, rel=0.05)


def test_folds_are_predicted_by_fits_to_the_others():
    target = rows(TRUE, rng=np.random.default_rng(0), noise=0.002)
    labels = np.where(target.layout.cluster < 5, 0, np.where(target.layout.cluster < 10, 1, -1))
    fit = calibrate(target, START, FREE, labels)
    assert len(fit.folds) == 2
    apart = calibrate(replace(target, samples=target.samples.take(np.arange(5, 20))), START, FREE)
    for name, estimate in apart.estimates.items():
        assert abs(fit.folds[0].value(name) - estimate.value) < estimate.stderr
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
        ({"pose": np.column_stack([np.arange(100.0), np.zeros(100), np.full(100, np.nan)])}, "no poses with headings"),
        ({"omega": np.zeros((100, 2))}, "the sprockets stand still"),
    ],
)
def test_drives_without_motion_or_headings_are_refused(change, message):
    with pytest.raises(LogError, match=message):
        Drives([replace(drive(np.arange(100) * 0.05), **change)], BASE.geometry)


GRIP = ("friction_ratio", "radius_left", "radius_right", "sensor_x", "sensor_y", "sensor_yaw", "clock")
ICE = ("friction", "friction_ratio", "radius_error", "sensor_x", "clock")
COMMANDS = ("friction_ratio", "radius_error", "lag", "sensor_x")
CASES = (
    ("shipped", Ground(), GRIP, "encoders", 0.003),
    ("husky", Ground(0.12, 0.12), ICE, "encoders", 0.01),
    ("maxxii", Ground(), COMMANDS, "commands", 0.003),
)


def recovered(robot, ground, free, inputs, noise, seed):
    """Estimates of a drawn robot's free parameters from ten of its drives, and their true values, by name."""
    rng = np.random.default_rng(seed)
    base = Candidate(load_parameters(robot)[0], ground)
    truth = drawn(base, free, rng)
    fit = calibrate(Drives(driven(truth, rng, noise=noise), base.geometry, inputs), base, free)
    return {name: (estimate, truth.value(name)) for name, estimate in fit.estimates.items()}


@pytest.mark.slow
@pytest.mark.parametrize("case", CASES, ids=[case[0] for case in CASES])
def test_intervals_contain_the_truth(case):
    """Of about 60 intervals of 95 %, at least 88 % do."""
    pairs = [pair for seed in range(200, 210) for pair in recovered(*case, seed).values()]
    inside = [estimate.low <= truth <= estimate.high for estimate, truth in pairs if not estimate.vague]
    assert len(inside) >= 30
    assert np.mean(inside) >= 0.88, np.mean(inside)
