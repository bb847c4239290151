from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import pytest

from sim import Fleet, Ground, RobotParameters, open_loop
from sim.calibration.calibration import calibrate
from sim.calibration.candidate import PARAMETERS, Candidate
from sim.calibration.targets import Drives, SteadyRows
from sim.robot.named import load_parameters
from sim.robot.robot import compiled
from sim.wander.motion import Driver, track_commands
from trackslip import se2
from trackslip.identification.samples import SlipSamples
from trackslip.logs.runlog import RunLog
from trackslip.skid_theory import steady_twist

BASE = Candidate()
TRUE = Candidate(
    RobotParameters(half_gauge=0.2, contact_length=0.42, radius_error=-0.012, com_y=0.015),
    Ground(0.7, 0.91),
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
    """Steady rows of a candidate that turns to both sides, with noise on the tracks' speeds over
    the faster one's.
    """
    turns = theory(candidate.robot, candidate.ground, OMEGA)
    yaw_rate = turns[:, 2:]
    place = candidate.sensor
    at_sensor = turns[:, :2] + yaw_rate * [-place.y, place.x]
    seen = se2.rotate(-place.yaw, at_sensor)
    twist = np.column_stack([seen[:, 0], yaw_rate])
    if rng is not None:
        fastest = np.abs(OMEGA).max(axis=1, keepdims=True) * 0.06
        errors = rng.normal(0, noise, OMEGA.shape) * fastest
        error_v = errors.mean(axis=1)
        error_w = (errors[:, 1] - errors[:, 0]) / (2 * candidate.robot.half_gauge)
        twist = twist + np.column_stack([error_v, error_w])
    names = [f"{k}" for k in range(len(OMEGA))]
    sideways = seen[:, 1] if lateral else None
    samples = SlipSamples.of(OMEGA, twist, candidate.geometry, names, lateral=sideways)
    return SteadyRows(samples, candidate.geometry, turns=theory)


def test_parameters_can_be_changed_and_read_back():
    for name, parameter in PARAMETERS.items():
        for limit in parameter.limits(BASE):
            value = parameter.unscaled(BASE, limit)
            assert parameter.low <= value <= parameter.high  # despite rounding
            read_back = BASE.with_values({name: value}).value(name)
            assert read_back == pytest.approx(value, rel=1e-6, abs=1e-9)
            assert parameter.scaled(BASE, value) == pytest.approx(limit, abs=1e-6)


@pytest.mark.parametrize(
    ("truth", "wrong"),
    [
        ({"friction_ratio": 1.3, "radius_error": -0.012, "com_y": 0.015}, 2.0),
        ({"shear": 0.008, "friction_ratio": 1.15}, 1.0),
        (
            {
                "sensor_x": 0.2,
                "sensor_y": -0.1,
                "sensor_yaw": 0.03,
                "radius_left": -0.02,
                "radius_right": 0.01,
            },
            1.0,
        ),
    ],
)
def test_parameters_are_found_in_steady_rows_despite_a_wrong_one(truth, wrong):
    target = rows(BASE.with_values(truth), lateral="sensor_x" in truth)
    target.samples.twist[3] *= wrong
    fit = calibrate(target, BASE, tuple(truth))
    for name, value in truth.items():
        assert fit.candidate.value(name) == pytest.approx(value, rel=0.01, abs=1e-3), name
    matrix = [[1.0 if a == b else fit.correlation[a][b] for a in truth] for b in truth]
    assert np.linalg.eigvalsh(matrix).min() > 0
    assert ("lateral_rms" in fit.metrics) == ("sensor_x" in truth)


def test_speeds_are_compared_as_measured_and_as_simulated():
    target = rows(TRUE, lateral=True)
    target.samples.lateral[0] = np.nan
    v, w, lateral = target.compared(target.errors(START))
    assert [(one.name, one.unit) for one in (v, w)] == [("v", "m/s"), ("w", "rad/s")]
    assert lateral.name == "lateral speed"
    simulated = target.predicted(START)
    for one, measured, expected in zip(
        (v, w, lateral),
        (*target.samples.twist.T, target.samples.lateral),
        simulated,
        strict=True,
    ):
        known = np.isfinite(measured)
        np.testing.assert_array_equal(one.measured, measured)
        np.testing.assert_allclose(one.simulated[known], expected[known], atol=1e-12)


def test_what_is_not_told_widens_the_intervals_of_the_others():
    """Only the product of ratio and length matters: their priors, 30 and 15 %, leave 13 % of the
    ratio unknown.
    """
    target = rows(BASE, rng=np.random.default_rng(3), noise=0.002)
    fit = calibrate(target, BASE, ("friction_ratio", "contact_length", "radius_error"))
    estimates = fit.estimates
    vague = {name: estimate.vague for name, estimate in estimates.items() if estimate.vague}
    assert vague == {"contact_length": "the target does not distinguish it from friction_ratio"}
    assert fit.candidate.robot.contact_length == pytest.approx(BASE.robot.contact_length, rel=0.01)
    without_length = calibrate(target, BASE, ("friction_ratio", "radius_error"))
    expected = without_length.estimates["friction_ratio"].value
    ratio = estimates["friction_ratio"]
    assert ratio.value == pytest.approx(expected, rel=0.01)
    share = 0.3 * 0.15 / np.hypot(0.3, 0.15)
    assert ratio.stderr == pytest.approx(share * expected, rel=0.05)


def test_folds_are_predicted_by_fits_to_the_others():
    target = rows(TRUE, rng=np.random.default_rng(0), noise=0.002)
    cluster = target.layout.cluster
    labels = np.where(cluster < 5, 0, np.where(cluster < 10, 1, -1))
    fit = calibrate(target, START, FREE, labels)
    assert len(fit.folds) == 2
    without_first = replace(target, samples=target.samples.take(np.arange(5, 20)))
    apart = calibrate(without_first, START, FREE)
    for name, estimate in apart.estimates.items():
        assert abs(fit.folds[0].value(name) - estimate.value) < estimate.stderr
    errors = np.full(len(labels), np.nan)
    for k, fold in enumerate(fit.folds):
        in_fold = labels == k
        errors[in_fold] = target.errors(fold)[in_fold]
    assert fit.held_out == target.metrics(errors)
    assert fit.held_out["w_rms"] < fit.held_out_before["w_rms"] / 3


def drive(time):
    omega = np.tile([3.0, 4.0], (len(time), 1))
    twist = np.array([0.21, 0.0, 0.06 / 0.336])
    return RunLog("drive", time, omega, se2.exp(time[:, None] * twist))


def test_no_window_contains_a_jump_of_the_poses():
    whole = drive(np.arange(0, 20, 0.05))
    after_jump = whole.time >= 10
    jumped = whole.pose + after_jump[:, None] * [3.0, 0.0, 0.0]
    wild = 60
    jumped[wild] += [0.0, 2.0, 1.0]
    target = Drives([replace(whole, pose=jumped)], BASE.geometry)
    for window in target.windows:
        contains_jump = window.time[0] < 10 < window.time[-1] - 0.05
        assert not contains_jump
    seen = np.concatenate([window.time[window.is_valid] for window in target.windows])
    assert whole.time[wild] not in seen
    metrics = target.metrics(target.errors(BASE))
    assert metrics["position_1s_p90"] < 0.2


@dataclass(frozen=True)
class Study:
    """A robot whose parameters are drawn and found again from its drives."""

    robot: str
    ground: Ground
    free: tuple[str, ...]
    inputs: str
    noise: float  # of the poses [m, rad]


STUDIES = {
    "grip": Study(
        robot="shipped",
        ground=Ground(),
        free=(
            "friction_ratio",
            "radius_left",
            "radius_right",
            "sensor_x",
            "sensor_y",
            "sensor_yaw",
            "clock",
        ),
        inputs="encoders",
        noise=0.003,
    ),
    "ice": Study(
        robot="husky",
        ground=Ground(0.12, 0.12),
        free=("friction", "friction_ratio", "radius_error", "sensor_x", "clock"),
        inputs="encoders",
        noise=0.01,
    ),
    "commands": Study(
        robot="maxxii",
        ground=Ground(),
        free=("friction_ratio", "radius_error", "lag", "sensor_x"),
        inputs="commands",
        noise=0.003,
    ),
}


@pytest.mark.slow
@pytest.mark.parametrize("name", STUDIES)
def test_intervals_contain_the_truth(name):
    """Of about 60 intervals of 95 % from ten drives of a drawn robot each, at least 88 % do."""
    study = STUDIES[name]
    inside = []
    parameters, _ = load_parameters(study.robot)
    base = Candidate(parameters, study.ground)
    for seed in range(200, 210):
        rng = np.random.default_rng(seed)
        truth = drawn(base, study.free, rng)
        drives = Drives(driven(truth, rng, study.noise), base.geometry, study.inputs)
        fit = calibrate(drives, base, study.free)
        for parameter, estimate in fit.estimates.items():
            if not estimate.vague:
                inside.append(estimate.low <= truth.value(parameter) <= estimate.high)
    assert len(inside) >= 30
    assert np.mean(inside) >= 0.88, np.mean(inside)


def drawn(base: Candidate, names: Sequence[str], rng: np.random.Generator) -> Candidate:
    """A candidate whose parameters differ from those of `base` as their priors allow, by up to two
    deviations.
    """
    values = {}
    for name in names:
        low, high = PARAMETERS[name].limits(base)
        scaled = np.clip(rng.normal(0.0, 0.7), max(low, -2.0), min(high, 2.0))
        if low == 0:  # a parameter that begins at its limit
            scaled = abs(rng.normal(0.0, 0.7))
        values[name] = PARAMETERS[name].unscaled(base, float(scaled))
    return base.with_values(values)


def driven(candidate: Candidate, rng: np.random.Generator, noise: float) -> list[RunLog]:
    """Ten drives of 15 s by random commands; every second row has a pose of the sensor, by its own
    clock.
    """
    robot = candidate.robot
    period = 0.05
    count = 10
    fleet = Fleet(compiled(robot), np.zeros((count, 3)), candidate.ground, robot.radius_error)
    driver = Driver(0.9 * fleet.drive.limit * robot.sprocket_radius, 5.0, robot.half_gauge)
    speeds = [track_commands("random", 15.0, 1 / period, driver, rng) for _ in range(count)]
    omega = np.stack(speeds, axis=1) / robot.sprocket_radius
    logs = []
    for log in open_loop(fleet, omega, 15.0, period=period):
        seen = log.time + candidate.clock
        true = np.stack([np.interp(seen, log.time, column) for column in log.truth.pose.T], axis=-1)
        pose = se2.compose(true, candidate.sensor.pose) + noise * rng.standard_normal(true.shape)
        is_even = np.arange(len(seen)) % 2 == 0
        valid = is_even & (seen >= 0) & (seen <= log.time[-1])
        measured = np.where(valid[:, None], pose, np.nan)
        logs.append(replace(log, pose=measured, valid=valid, truth=None))
    return logs
