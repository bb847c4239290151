"""Runs on other grounds, or with a sensor that was mounted anew."""

from dataclasses import replace

import numpy as np
import pytest
from plain_drives import HUSKY, drive_of, log_of, measured

from trackslip.drives.conditioning import drives_of
from trackslip.identification.identify import identify
from trackslip.identification.law_fit import fit_drives
from trackslip.intervals import mean_of_groups
from trackslip.se2 import Mounting

TWO_GROUNDS = [0.03, 0.03, 0.03, 0.13, 0.13, 0.13]


@pytest.fixture(autouse=True)
def few_laws(monkeypatch):
    laws = ("none", "icr_radius")
    monkeypatch.setattr("trackslip.identification.drive_comparison.drive_laws", lambda: laws)


def runs(offsets, mountings=()):
    """A run of a minute with each D [m], seen by sensors at `mountings`, by default in the
    middle.
    """
    logs = []
    for k, offset in enumerate(offsets):
        drive = drive_of(replace(HUSKY, offset=offset), seed=k, slip=0.02, duration=60.0)
        time, pose = measured(drive, seed=10_000 + k)
        if mountings:
            sensor = mountings[k]
            ahead = sensor.x + 1j * sensor.y
            place = ahead * np.exp(1j * pose[:, 2])
            pose = pose + np.column_stack([place.real, place.imag, np.full(len(pose), sensor.yaw)])
        logs.append(log_of(drive, time, pose, f"run {k}"))
    return logs


def identified(logs):
    return identify(logs, HUSKY.geometry, method="drive")


@pytest.mark.parametrize("order", [TWO_GROUNDS, TWO_GROUNDS[::-1], TWO_GROUNDS[:5]])
def test_the_answer_on_two_grounds_is_the_mean(order):
    found = identified(runs(order))
    answer = found.answer["offset"]
    assert answer.value == pytest.approx(np.mean(order), abs=0.002)
    assert answer.low < np.mean(order) < answer.high
    # Student's t for the mean of so many runs, by hand
    t = {6: 2.571, 5: 2.776}[len(order)]
    assert answer.error == pytest.approx(t * np.std(order, ddof=1) / np.sqrt(len(order)), rel=0.1)


def test_the_runs_at_both_ends_are_named():
    (alarm,) = identified(runs(TWO_GROUNDS)).alarms
    assert alarm.kind == "runs"
    low = 1 + 0.03 / HUSKY.half_gauge
    high = 1 + 0.13 / HUSKY.half_gauge
    assert alarm.line.startswith("slip differs between the 6 runs, wheel_separation_multiplier")
    assert f"from {low:.2f}"[:8] in alarm.line
    assert f"to {high:.2f}"[:6] in alarm.line
    assert alarm.line.endswith("mean of the runs; identify those of each ground alone")


def test_two_runs_that_differ_have_no_mean():
    (alarm, *_) = identified(runs([0.03, 0.13])).alarms
    assert "two runs don't tell their mean: take 3 or more" in alarm.line


@pytest.mark.parametrize("count", [2, 3, 8])
def test_runs_of_one_ground_raise_no_alarm(count):
    found = identified(runs([HUSKY.offset] * count))
    assert found.alarms == ()
    assert abs(found.answer["offset"].value - HUSKY.offset) < 0.003


def test_intervals_of_many_runs_know_that_they_differ():
    scatter = 0.03 * np.random.default_rng(8).normal(size=8)
    drives = drives_of(runs(HUSKY.offset + scatter))[0]
    fit = fit_drives("icr_radius", drives, HUSKY.geometry)
    assert fit.stderr["offset"] == pytest.approx(np.std(scatter, ddof=1) / np.sqrt(8), rel=0.1)


def test_a_sensor_that_was_mounted_anew_is_fitted_in_each_run():
    mountings = [Mounting(0.2, 0.0, 0.0), Mounting(0.1, 0.1, 0.3), Mounting(-0.15, -0.05, -0.2)]
    found = identified(runs([HUSKY.offset] * 3, mountings))
    (alarm,) = found.alarms
    assert alarm.line.startswith("the sensor was mounted anew in the 3 runs, sensor_x from")
    assert "slip" not in alarm.line
    answer = found.answer["offset"]
    assert abs(answer.value - HUSKY.offset) < 0.004
    assert answer.error < 0.02


def test_means_of_groups_with_equal_errors_are_plain_means():
    values = np.random.default_rng(1).normal(size=(7, 2))
    mean, covariance = mean_of_groups(values, np.full((7, 2), 1e-4))
    np.testing.assert_allclose(mean, values.mean(axis=0))
    np.testing.assert_allclose(covariance, np.cov(values.T) / 7)


def test_the_scatter_between_two_groups_has_a_closed_form():
    """Of y = 0 and 5 with variances 1 and 4 it is (5^2 - 1 - 4) / 2 = 10, so that the weights are
    1 / 11 and 1 / 14.
    """
    mean, _ = mean_of_groups(np.array([[0.0], [5.0]]), np.array([[1.0], [4.0]]))
    assert mean[0] == pytest.approx(5.0 * 11 / (11 + 14))


def test_a_group_that_tells_nothing_has_no_weight():
    values = np.array([[1.0], [1.2], [1.1], [9.0]])
    variance = np.array([[0.01], [0.01], [0.01], [1e6]])
    mean, _ = mean_of_groups(values, variance)
    assert mean[0] == pytest.approx(1.1, abs=1e-3)
