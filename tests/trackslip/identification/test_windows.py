from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from drives import EXACT, GEOMETRY, ICR, SLAM, STILL, drive_log, fitted, model, without_poses
from plain_drives import HUSKY, log_of, measured
from plain_drives import drive_of as plain_drive

from trackslip.bags.drives import load
from trackslip.drives.conditioning import drive_of, drives_of
from trackslip.drives.drive import Drive, Drives
from trackslip.drives.first_look import first_look
from trackslip.identification.law_fit import fit_drives
from trackslip.identification.path import DriveModel
from trackslip.identification.windows import LOSS, Residuals, Windows, fit_windows, residuals
from trackslip.kinematics import RobotGeometry
from trackslip.laws.families import FAMILIES
from trackslip.se2 import Mounting

LOGS = Path(__file__).parents[3] / "examples/logs"
LAWS = {
    "icr_radius": [0.045, 0.0066],
    "turn_loss": [0.045, 0.0066, 0.3],
    "icr_sides": [0.04, 0.05, 0.01, -0.01],
    "turn_loss_sides": [0.045, 0.01, -0.01, 0.3],
    "centrifugal": [0.045, 0.0066, 0.3, 0.2],
}
PLACED = [0.1, 0.05, 0.2, 0.03, 0.07]  # sensor_x, sensor_y, drift, clock_offset, sensor_yaw
NONE = np.zeros(0, int)


def random_drive(seed=0, count=60, gyro=False):
    """Random poses, and sprocket speeds in intervals of their own."""
    rng = np.random.default_rng(seed)
    edges = np.arange(0, count / 10 + 2, 0.02)
    omega = 2 + np.cumsum(rng.normal(size=(len(edges) - 1, 2)) * 0.1, axis=0)
    time = 1 + np.arange(count) * 0.1
    pose = np.cumsum(rng.normal(size=(count, 3)) * 0.05, axis=0)
    turned = None
    if gyro:
        angle = np.cumsum(rng.normal(size=len(edges)) * 0.01)
        turned = np.column_stack([edges, angle, edges])
    return Drive(f"random {seed}", edges, omega, time, pose, 0.1, gyro=turned)


@pytest.mark.parametrize("gyro", [False, True])
@pytest.mark.parametrize("lag", [0.0, 0.08])
@pytest.mark.parametrize("name", LAWS)
def test_slopes_are_differences(name, lag, gyro):
    """At the weighted means only: the frame that the residuals are told in turns with the fit, to
    second order. So what a turn of the residuals explains is taken off positions' differences.
    """
    data = Drives.of([random_drive(gyro=gyro)])
    driven = DriveModel(FAMILIES[name], GEOMETRY, gyro)
    of_gyro = [0.01, 0.02] if gyro else []
    values = np.array([*LAWS[name], *PLACED, lag, *of_gyro])
    windows = Windows.cut(data, 2.0)
    weight = data.known[:, windows.pose] / np.array([[0.02], [0.03]]) ** 2
    free = np.arange(len(values))
    found = residuals(driven, data, windows, values, free, weight)

    def residuals_at(values):
        return residuals(driven, data, windows, values, NONE, weight).value

    for k, parameter in enumerate(driven.names):
        ahead = values + 1e-6 * (free == k)
        behind = values - 1e-6 * (free == k)
        if parameter == "lag":
            behind = values  # 0 is its limit, and its slope is such a difference itself
        change = residuals_at(ahead) - residuals_at(behind)
        expected = change / (ahead[k] - behind[k])
        largest = max(np.abs(expected).max(), 1e-3)
        within = (2e-2 if parameter == "lag" else 1e-5) * largest

        # positions as complex numbers
        slope = found.slope[0, k] + 1j * found.slope[1, k]
        missed = expected[0] + 1j * expected[1] - slope
        turning = 1j * (found.value[0] + 1j * found.value[1])  # of the frame
        along_turning = np.real(missed * np.conj(turning)) / np.maximum(np.abs(turning) ** 2, 1e-12)
        rest = np.abs(missed - turning * along_turning)
        np.testing.assert_allclose(rest, 0.0, atol=within, err_msg=parameter)

        if parameter == "clock_offset":
            expected[3:] = 0.0  # gyros have the encoders' clock
        np.testing.assert_allclose(found.slope[2:, k], expected[2:], atol=within, err_msg=parameter)


@pytest.mark.parametrize("length", [0.5, 2.0, 10.0])
@pytest.mark.parametrize("kind", ["poses", "positions", "headings"])
def test_an_exact_path_leaves_nothing_wherever_it_is(length, kind):
    drive = drive_of(drive_log(1, 20, EXACT, STILL))
    x, y, heading = drive.pose.T
    turn = 1.1
    place = np.exp(1j * turn) * (x + 1j * y) + (300 - 70j)
    moved = np.column_stack([place.real, place.imag, heading + turn])
    missing = {"poses": [], "positions": [2], "headings": [0, 1]}[kind]
    moved[:, missing] = np.nan
    data = Drives.of([replace(drive, pose=moved)])
    windows = Windows.cut(data, length)
    values = np.array([ICR.offset, ICR.radius_error, *np.zeros(6)])
    weight = data.known[:, windows.pose] * 1e4
    found = residuals(model(), data, windows, values, NONE, weight)
    assert np.abs(found.value[found.known]).max() < 2e-5
    has_positions = kind != "headings"
    has_headings = kind != "positions"
    is_known = found.known[:3].any(axis=1)
    np.testing.assert_array_equal(is_known, [has_positions, has_positions, has_headings])


def test_a_residual_at_the_scale_of_cauchys_loss_has_half_weight():
    value = LOSS * np.array([[0.0, 0.6, 0.0], [0.0, 0.8, 0.0], [0.0, 0.0, 0.1]])
    of_windows = Residuals(value, np.zeros((3, 0, 3)), np.ones((3, 3)))
    found = of_windows.alignment(np.array([1.0, 0.1, 1.0]))
    np.testing.assert_allclose(found, [[1.0, 0.5, 1.0], [100.0, 100.0, 50.0]])


def white(seed, **source):
    """A fit to a drive without varying slip, cut where its poses jump, whose sensor is known."""
    log = drive_log(seed, 60.0, replace(SLAM, **source), STILL)
    drives, _ = drives_of([log])
    look = first_look(drives, GEOMETRY)
    return fit_drives("icr_radius", look.drives, GEOMETRY, Mounting())


@pytest.mark.parametrize(
    "wrong", [{"outliers": 0.05}, {"jumps": 2, "jump_size": 0.5, "jump_turn": 0.2}]
)
def test_outlying_poses_and_jumps_hardly_matter(wrong):
    clean = white(0)
    spoilt = white(0, **wrong)
    for name, value in spoilt.values.items():
        assert value == pytest.approx(getattr(ICR, name), abs=3 * spoilt.stderr[name])
        assert spoilt.stderr[name] < 3 * clean.stderr[name]


def test_fits_of_a_real_drive_end_at_a_minimum():
    """On grass most residuals are on the flat part of the loss, where reweighted least squares
    takes small steps.
    """
    log = load(LOGS / "warthog_grass_2.parquet")[0]
    drives, _ = drives_of(log.cut(150.0)[:1])
    geometry = RobotGeometry(0.54, 0.3)
    reference = fit_drives("icr_radius", drives, geometry)
    for name in ("icr_radius", "icr_sides"):
        found = fit_drives(name, drives, geometry, reference=reference)
        fit = found.fit
        none = np.zeros(len(fit.values))
        again = fit_windows(fit.model, fit.drives, fit.length, fit.values, found.held, none)
        moved = np.abs(again.values - fit.values)[fit.free]
        error = np.sqrt(np.diag(fit.covariance))
        assert (moved < 0.1 * error).all(), name


def test_leaving_out_blocks_by_one_step_is_a_first_order_refit():
    logs = [drive_log(seed, 12.0) for seed in range(10)]
    found = fitted("icr_radius", *logs)
    fit = found.fit
    none = np.zeros(len(fit.values))
    assert found.blocks == 10
    error = np.sqrt(np.diag(fit.covariance))[:2]
    for k in range(10):
        data = Drives.of([drive for j, drive in enumerate(fit.drives.drives) if j != k])
        again = fit_windows(fit.model, data, fit.length, fit.values, found.held, none)
        (stepped,) = fit.without(np.arange(10)[None] == k)
        step = stepped - fit.values
        refit = again.values - fit.values
        np.testing.assert_allclose(step[:2] / error, refit[:2] / error, atol=0.2)
    assert fitted("icr_radius", *logs[:5]).stderr == {}


@pytest.mark.parametrize(("kind", "used"), [("positions", False), ("poses", True)])
def test_windows_of_a_standstill_need_headings(kind, used):
    """Positions alone don't tell how such a window is turned: its slopes were of any size."""
    speed = np.repeat([0.4, 0.0, 0.4], [5, 5, 5])
    drive = plain_drive(commands=(speed, speed), hold=4.0, duration=60.0)
    time, pose = measured(drive, pose_step=0.2)
    if kind == "positions":
        pose[:, 2] = np.nan
    (prepared,), _ = drives_of([log_of(drive, time, pose)])
    data = Drives.of([prepared])
    windows = Windows.cut(data, 5.0)
    driven = DriveModel(FAMILIES["icr_radius"], HUSKY.geometry)
    values = np.array([HUSKY.offset, HUSKY.radius_error, *np.zeros(6)])
    weight = data.known[:, windows.pose] / 0.005**2
    found = residuals(driven, data, windows, values, NONE, weight)
    is_resting = windows.at_rows(np.abs(data.time[windows.middle] - 31.0) < 5.0)
    assert found.known[0, is_resting].any() == used
    is_moving = windows.at_rows(data.time[windows.middle] < 16.0)
    assert found.known[0, is_moving].all()


def test_blocks_are_numbered_without_gaps():
    """No pair is predicted by a fit that contains its block, though poses are missing for 42 s."""
    log = drive_log(1, 150.0)
    log = without_poses(log, (log.time > 60.0) & (log.time < 102.0))
    fit = fitted("icr_radius", log).fit
    assert len(fit.score) == fit.block.max() + 1
    assert set(fit.block) == set(range(len(fit.score)))
