from dataclasses import replace

import numpy as np
import pytest
from drives import EXACT, GEOMETRY, ICR, SLAM, STILL, constant_speeds, drive_log, fitted
from law_motion import WHITE
from plain_drives import HUSKY, drive_of, log_of, measured

from trackslip.drives.conditioning import drives_of
from trackslip.identification.comparison import REFERENCE
from trackslip.identification.law_fit import fit_drives
from trackslip.laws.base import NoSlip
from trackslip.laws.families import FAMILIES, drive_laws
from trackslip.laws.icr import ConstantIcr, IcrSides
from trackslip.laws.turn_loss import Centrifugal, TurnLoss, TurnLossSides
from trackslip.se2 import Mounting

MOUNTED = replace(SLAM, ahead=0.3, left=0.1, mounting=np.radians(5), delay=0.15)
PLACE = {"sensor_x": 0.3, "sensor_y": 0.1, "sensor_yaw": np.radians(5), "clock_offset": -0.15}
LAWS = {
    "none": NoSlip(),
    "icr_radius": ConstantIcr(-0.02, 0.168, -0.03),
    "turn_loss": TurnLoss(0.1, 0.168, 0.01, 0.4),
    "turn_loss_sides": TurnLossSides(0.1, 0.03, -0.02, 0.168, 0.4),
    "icr_sides": IcrSides(0.04, 0.05, 0.005, 0.012, 0.168),
    "centrifugal": Centrifugal(0.1, 0.168, 0.01, 0.4, 0.3),
}


def fast(duration=120.0):
    """Belt speeds of up to 2 m/s, changed every second."""
    knots = np.arange(int(duration) + 1)
    speeds = np.random.default_rng(0).uniform(-1, 2, (len(knots), 2))
    time = np.arange(50 * int(duration) + 1) / 50
    left, right = speeds.T
    return np.column_stack([np.interp(time, knots, left), np.interp(time, knots, right)])


def found_by(fit):
    """All values of a fit by name."""
    return fit.values | fit.extras


def require_within(fit, true, errors=4.0):
    found = found_by(fit)
    for name, value in true.items():
        assert abs(found[name] - value) < errors * fit.stderr[name], name


@pytest.mark.parametrize(
    ("name", "variation"), [("icr_radius", STILL), *((name, WHITE) for name in drive_laws())]
)
def test_every_law_is_found_within_its_errors(name, variation):
    law = LAWS[name]
    driving = fast() if FAMILIES[name].fast else "random"
    fit = fitted(name, drive_log(1, 120.0, SLAM, variation, law, driving))
    assert fit.name == name
    assert tuple(fit.values) == FAMILIES[name].names
    require_within(fit, {key: getattr(law, key) for key in fit.values})
    assert fit.correlation.shape == (len(fit.stderr), len(fit.stderr))
    np.testing.assert_allclose(np.diag(fit.correlation), 1.0)
    for key, (low, high) in fit.interval95.items():
        value = found_by(fit)[key]
        assert value - low == pytest.approx(high - value)
        assert high - value > 1.96 * fit.stderr[key]  # Student's t


def test_motion_without_noise_gives_the_law_exactly():
    exact = replace(EXACT, ahead=0.3, left=0.1, mounting=np.radians(5), delay=0.15)
    fit = fitted(REFERENCE, drive_log(1, 60.0, exact, STILL, drift=0.1, turning_centre=-0.05))
    law = {"offset": ICR.offset, "radius_error": ICR.radius_error}
    # the sensor stands 0.3 m ahead of the origin, 0.35 m ahead of the turning centre
    true = law | PLACE | {"sensor_x": 0.35, "drift": 0.1}
    for key, value in true.items():
        within = 2e-3 if key in ("drift", "sensor_x") else 2e-4
        assert found_by(fit)[key] == pytest.approx(value, abs=within)


def test_a_given_sensor_is_held_and_improves_the_rest():
    log = drive_log(1, 80.0, MOUNTED)
    given = fitted(REFERENCE, log, sensor=Mounting(0.3, 0.1, np.radians(5)))
    is_given = {key for key, why in given.held.items() if why == "given"}
    assert is_given == {"sensor_y", "sensor_yaw"}
    assert given.extras["sensor_y"] == 0.1
    assert not {*given.held} & {*given.interval95}
    free = fitted(REFERENCE, log)
    assert given.stderr["radius_error"] < 1.1 * free.stderr["radius_error"]


def test_unequal_radii_under_a_sensor_off_the_middle():
    law = IcrSides(0.045, 0.045, 0.02, -0.02, 0.168)
    fit = fitted("icr_sides", drive_log(1, 120.0, MOUNTED, law=law))
    require_within(fit, {"radius_error_left": 0.02, "radius_error_right": -0.02})
    mean_offset = (fit.values["offset_left"] + fit.values["offset_right"]) / 2
    assert mean_offset == pytest.approx(0.045, abs=0.002)


@pytest.mark.parametrize("lag", [0.0, 0.15])
def test_a_lag_is_estimated_only_on_request(lag):
    log = drive_log(2, 30.0, EXACT, STILL, lag=lag)
    fit = fitted(REFERENCE, log, lag=True)
    assert fit.extras["lag"] == pytest.approx(lag, abs=5e-3)
    assert fit.extras["clock_offset"] == pytest.approx(0, abs=5e-3)
    assert fit.values["offset"] == pytest.approx(ICR.offset, abs=2e-4)
    without = fitted(REFERENCE, log)
    assert without.held["lag"] == "not asked for"
    assert without.extras["lag"] == 0.0
    assert without.extras["clock_offset"] == pytest.approx(-lag, abs=0.02)


def test_a_gyro_has_a_bias_and_a_scale():
    log = drive_log(3, 120.0, SLAM)
    step = np.diff(log.time)
    noise = np.random.default_rng(0).normal(0.0, 1e-3 / np.sqrt(step))
    rate = np.diff(np.unwrap(log.truth.pose[:, 2])) / step
    gyro = np.append(np.nan, 1.02 * rate + 0.01 + noise)
    fit = fitted(REFERENCE, replace(log, gyro=gyro))
    true = {"gyro_bias": 0.01, "gyro_scale": 0.02, "clock_offset": 0.0, "offset": ICR.offset}
    require_within(fit, true)
    assert fit.stderr["gyro_bias"] < 1e-3
    assert 3e-4 < fit.noise["gyro"] < 3e-3
    without = fitted(REFERENCE, log)
    assert not {"gyro_bias", "gyro"} & {*without.extras, *fit.held}


@pytest.mark.parametrize("value", [-0.97, 9.5])
def test_values_stop_at_limits_and_say_so(value):
    log = drive_log(1, 60.0, EXACT, STILL)
    fit = fitted(REFERENCE, replace(log, omega=log.omega / (1 + value)))
    low, high, _ = FAMILIES[REFERENCE].limits(GEOMETRY.half_gauge)
    assert "radius_error" in fit.at_limit
    assert low[1] <= fit.values["radius_error"] <= high[1]
    assert fitted(REFERENCE, log).at_limit == ()


@pytest.mark.parametrize("start", [None, {"radius_error": 0.0}])
def test_positions_alone_find_the_right_minimum_without_a_start(start):
    """Of 200 drives, fits to shorter windows first, each cut once, took the 84th to D = -271 mm;
    D's error is 7 mm.
    """
    seed = 84
    drive = drive_of(seed=seed, slip=0.05)
    time, pose = measured(drive, position_noise=0.01, seed=10_000 + seed)
    log = log_of(drive, time, pose * [1, 1, np.nan])
    drives, _ = drives_of([log])
    fit = fit_drives(REFERENCE, drives, HUSKY.geometry, start=start)
    assert fit.values["offset"] == pytest.approx(HUSKY.offset, abs=0.025)
    assert fit.values["radius_error"] == pytest.approx(HUSKY.radius_error, abs=0.025)


@pytest.mark.parametrize(
    ("speeds", "vague", "known"),
    [
        pytest.param((0.2, 0.2), "offset", {"radius_error": ICR.radius_error}, id="straight"),
        pytest.param((0.1, 0.2), "radius_error", {}, id="one arc"),
    ],
)
def test_what_the_driving_does_not_tell_is_said(speeds, vague, known):
    fit = fitted(REFERENCE, drive_log(1, 70.0, driving=constant_speeds(*speeds, 70.0)))
    assert fit.held[vague] == "the driving doesn't determine it"
    require_within(fit, known)


def test_what_was_not_measured_is_held():
    log = drive_log(1, 70.0, EXACT)
    positions = fitted(REFERENCE, replace(log, pose=log.pose * [1, 1, np.nan]))
    assert positions.held["sensor_yaw"] == "no headings were measured"
    headings = fitted(REFERENCE, replace(log, pose=log.pose * [np.nan, np.nan, 1]))
    for name in ("sensor_x", "sensor_y", "drift", "radius_error"):
        assert headings.held[name] == "no positions were measured"
    half_gauge = GEOMETRY.half_gauge
    gain = half_gauge / (half_gauge + headings.values["offset"])
    true = half_gauge * (1 + ICR.radius_error) / (half_gauge + ICR.offset)
    assert gain == pytest.approx(true, rel=2e-3)
