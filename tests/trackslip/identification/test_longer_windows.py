"""Pose sources whose errors depend on the length of windows."""

import numpy as np
import pytest
from plain_drives import HUSKY, drive_of, log_of, measured

from trackslip import se2
from trackslip.drives.conditioning import drives_of
from trackslip.identification.identify import identify
from trackslip.identification.law_fit import fit_drives
from trackslip.identification.longer_windows import covering_longer_windows
from trackslip.logs.runlog import RunLog


@pytest.fixture(autouse=True)
def few_laws(monkeypatch):
    laws = ("none", "icr_radius")
    monkeypatch.setattr("trackslip.identification.drive_comparison.drive_laws", lambda: laws)


def as_measured(pose):
    return pose


def averaged(pose, half):
    """Headings averaged over 2 `half` + 1 rows."""
    padded = np.pad(pose[:, 2], half, mode="edge")
    weights = np.ones(2 * half + 1) / (2 * half + 1)
    return np.column_stack([pose[:, :2], np.convolve(padded, weights, "valid")])


def smoothed(pose):
    """Headings averaged over 3 s, as by a filter that smooths turns."""
    return averaged(pose, half=15)


def drifting(pose):
    """Headings that drift as a random walk of 0.01 rad/√s, and positions along them."""
    steps = se2.steps(pose)
    steps[:, 2] += 0.01 * np.sqrt(0.1) * np.random.default_rng(0).normal(size=len(steps))
    return se2.chain(pose[0], steps)


def logged(source, seed: int) -> RunLog:
    drive = drive_of(seed=seed, slip=0.02, duration=240.0)
    time, pose = measured(drive, position_noise=0.005, heading_noise=0.003, seed=10_000 + seed)
    return log_of(drive, time, source(pose))


def test_a_source_that_smooths_turns_is_an_alarm():
    found = identify(logged(smoothed, 2), HUSKY.geometry, method="drive")
    (alarm,) = [alarm for alarm in found.alarms if alarm.kind == "windows"]
    assert "the intervals cover both" in alarm.line
    gain = found.answer["offset"]
    assert gain.low < HUSKY.offset < gain.high


@pytest.mark.parametrize("source", [as_measured, drifting])
def test_without_smoothing_windows_agree(source):
    found = identify(logged(source, 2), HUSKY.geometry, method="drive")
    assert found.alarms == ()
    gain = found.answer["offset"]
    assert gain.low < HUSKY.offset < gain.high


def test_where_windows_agree_the_fit_stays_as_it_is():
    drives = drives_of([logged(as_measured, 2)])[0]
    fit = fit_drives("icr_radius", drives, HUSKY.geometry)
    covering, longer = covering_longer_windows(fit, np.zeros(len(fit.fit.values)))
    assert longer is None
    assert covering is fit


def slightly_smoothed(pose):
    """Headings averaged over 1.3 s."""
    return averaged(pose, half=6)


def test_a_difference_that_hardly_matters_is_no_alarm():
    """It only widens the intervals."""
    drives = drives_of([logged(slightly_smoothed, 2)])[0]
    fit = fit_drives("icr_radius", drives, HUSKY.geometry)
    covering, longer = covering_longer_windows(fit, np.zeros(len(fit.fit.values)))
    assert longer.differing
    assert longer.outside == ()
    assert covering.interval95 != fit.interval95


def test_intervals_cover_the_values_in_longer_windows():
    drives = drives_of([logged(smoothed, 2)])[0]
    fit = fit_drives("icr_radius", drives, HUSKY.geometry)
    covering, longer = covering_longer_windows(fit, np.zeros(len(fit.fit.values)))
    assert longer.longer == 4 * longer.shorter
    low, high = covering.interval95["offset"]
    assert low <= longer.differing["offset"].low
    assert high == fit.interval95["offset"][1]
    assert covering.values == fit.values
