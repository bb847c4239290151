"""A gyro's bias, scale, clock and noise, estimated with the drive."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from drives import GEOMETRY, SLAM, drive_log

from sim.wander.motion import LASTING
from sim.wander.pose_source import PoseSource
from trackslip.identification.drive_law import fit_drives
from trackslip.identification.drive_residuals import Nodes, residuals
from trackslip.identification.drives import drive_of

BIAS, SCALE, NOISE = 0.01, 0.02, 1e-3
LATE = replace(SLAM, delay=0.2)
TRUE = {"gyro_bias": BIAS, "gyro_scale": SCALE, "gyro_clock": -LATE.delay}


def with_gyro(log, seed=0):
    """The log with readings of a gyro with these errors of the true yaw rate."""
    step = np.diff(log.time)
    noise = np.random.default_rng(seed).normal(0.0, NOISE / np.sqrt(step))
    rate = np.diff(np.unwrap(log.truth.pose[:, 2])) / step
    return replace(log, gyro=np.append(np.nan, (1 + SCALE) * rate + BIAS + noise))


@pytest.fixture(scope="module")
def log():
    return with_gyro(drive_log(3, 120.0, LATE, LASTING))


def require_true(fit):
    for name in ("gyro_bias", "gyro_scale"):
        low, high = fit.interval95[name]
        assert abs(fit.extras[name] - TRUE[name]) < high - low, name
    assert fit.extras["gyro_clock"] == pytest.approx(TRUE["gyro_clock"], abs=0.02)


def test_its_errors_are_found_with_the_drive(log):
    fit = fit_drives("icr_radius", [log], GEOMETRY)
    require_true(fit)
    assert fit.stderr["gyro_bias"] < 1e-3
    assert NOISE / 5 < fit.noise["gyro"] < 2 * NOISE
    assert fit.values["offset"] == pytest.approx(0.045, abs=4 * fit.stderr["offset"] + 0.002)


def test_positions_alone_suffice(log):
    place = replace(log, pose=log.pose * [1, 1, np.nan])
    fit, without = (fit_drives("icr_radius", [one], GEOMETRY) for one in (place, replace(place, gyro=None)))
    require_true(fit)
    truth = np.interp(fit.fit.nodes.time - LATE.delay, log.time, log.truth.pose[:, 2])
    missed = [np.std(one.fit.states[:, 2] - truth) for one in (fit, without)]
    assert missed[0] < 0.7 * missed[1]


def test_without_a_gyro_it_has_no_parameters(log):
    fit = fit_drives("icr_radius", [replace(log, gyro=None)], GEOMETRY)
    assert not {*TRUE} & {*fit.extras, *fit.held}
    assert "gyro" not in fit.noise


def test_gaps_and_drives_without_a_gyro_are_no_readings(log):
    gap = (log.time > 40) & (log.time < 60)
    gappy = replace(log, gyro=np.where(gap, np.nan, log.gyro))
    other = replace(drive_log(4, 60.0, LATE, LASTING), run="other")
    fit = fit_drives("icr_radius", [other, gappy], GEOMETRY)
    require_true(fit)
    taken = np.isfinite(fit.fit.residuals.distance[:, -1])
    nodes = fit.fit.nodes
    first = nodes.first[1]
    assert not taken[:first].any()
    inside = nodes.time[first:-1]
    assert not taken[first:][(inside > 40.5) & (inside < 59.5)].any()
    assert taken[first:][(inside > 1) & (inside < 39)].all()


def test_derivatives_by_its_parameters_are_differences(log):
    fit = fit_drives("icr_radius", [log.between(0, 3000)], GEOMETRY).fit
    model, nodes = fit.model, Nodes.of([drive_of(log)])
    states = np.column_stack([np.zeros((len(nodes.time), 2)), 0.3 * nodes.time])
    free = np.array([model.index(name) for name in TRUE])
    found = residuals(model, nodes, states, fit.values, free)
    for k, parameter in enumerate(free):
        step = 1e-6 * (np.arange(len(fit.values)) == parameter)
        after, before = (residuals(model, nodes, states, fit.values + sign * step, free).step for sign in (1, -1))
        np.testing.assert_allclose((after - before)[1:-1] / 2e-6, found.by_values[1:-1, :, k], atol=1e-5)


def test_a_gyro_narrows_the_errors_of_drifting_headings():
    vague = PoseSource(rate=10.0, position_noise=0.02, heading_noise=np.radians(5.0))
    log = with_gyro(drive_log(5, 60.0, vague))
    fit, without = (fit_drives("icr_radius", [one], GEOMETRY) for one in (log, replace(log, gyro=None)))
    assert fit.stderr["offset"] < without.stderr["offset"]
