"""Alarms and doubts about laws of whole drives."""

from dataclasses import replace

import numpy as np
import pytest
from drives import EXACT, GEOMETRY, ICR, SLAM, STILL, constant_speeds, drive_log

from trackslip.doubts import severity
from trackslip.errors import InvalidValueError, LogError
from trackslip.identification.comparison import compare_drives
from trackslip.identification.drives import drive_of
from trackslip.identification.identify import identify
from trackslip.logs.runlog import RunLog
from trackslip.slip.icr import ConstantIcr

NAMES = ("none", "icr_radius")


def alarms(*logs):
    found = compare_drives([drive_of(log) for log in logs], GEOMETRY, names=NAMES)
    return [line for line in found.warnings if severity(line) == "alarm"]


@pytest.fixture
def few_laws(monkeypatch):
    monkeypatch.setattr("trackslip.identification.comparison.drive_laws", lambda: NAMES)


def test_a_good_drive_raises_no_alarm():
    assert alarms(drive_log(1, 60)) == []
    assert alarms(drive_log(2, 40, EXACT, STILL)) == []


def test_many_outlying_poses_are_an_alarm():
    (line,) = alarms(drive_log(1, 60, replace(SLAM, outliers=0.2, outlier_size=0.5)))
    assert "poses left out (" in line
    assert "the laws hold for the rest alone" in line


def test_halves_on_different_grounds_contradict_each_other():
    other = ConstantIcr(0.12, 0.168, -0.05)
    (line,) = alarms(drive_log(1, 60), replace(drive_log(2, 60, law=other), run="other"))
    assert line.startswith("law icr_radius contradicts itself")
    assert "offset" in line
    log = drive_log(3, 60)
    slow = np.where(log.time[:, None] > 30, 1.3, 1.0)  # a gear that changes half-way
    assert alarms(replace(log, omega=log.omega * slow))


@pytest.mark.parametrize("lengths", [(25, 40), (40, 12), (15, 15, 40)])
def test_halves_of_unequal_drives_are_compared(lengths):
    logs = [replace(drive_log(seed, length), run=f"drive {seed}") for seed, length in enumerate(lengths)]
    assert not any("contradicts" in line for line in alarms(*logs))


def test_driving_that_shows_too_little_is_an_alarm():
    (line,) = alarms(drive_log(1, 30, SLAM, driving=constant_speeds(0.15, 0.15)))
    assert line.startswith("the driving shows too little")
    assert "offset is held at" in line
    (line,) = alarms(drive_log(1, 30, SLAM, driving=constant_speeds(0.1, 0.2)))
    assert "sensor_y is held at" in line
    assert any("the belts drive 1.2 m" in line for line in alarms(drive_log(1, 10)))


@pytest.mark.usefixtures("few_laws")
def test_alarms_are_the_first_warnings_and_stored():
    logs = [drive_log(seed, 12) for seed in (1, 2)]
    short = [replace(one.between(0, 12), run=f"short {k}") for k, one in enumerate(logs)]
    found = identify([*logs, *short], GEOMETRY, method="drive")
    assert found.alarms[0] == found.warnings[0]
    assert found.alarms[0].startswith("2 of 4 runs left out (50 %)")
    assert {one.run for one in found.outliers} == {"short 0", "short 1"}


def far(ratio, seed=1):
    """A drive whose poses show `ratio` times the way and the turns of the sprockets."""
    log = drive_log(seed, 30)
    return replace(log, omega=log.omega / ratio)


@pytest.mark.usefixtures("few_laws")
def test_ice_is_no_gear_and_one_can_insist_on_what_is():
    assert any("0.63 times as far" in line for line in identify(far(0.63), GEOMETRY, method="drive").warnings)
    assert identify(far(0.3), GEOMETRY, method="drive").laws
    with pytest.raises(LogError, match=r"move 0.06\S* times as far .*gear of about .* \(--accept units insists\)"):
        identify(far(0.06), GEOMETRY, method="drive")
    assert identify(far(0.06), GEOMETRY, method="drive", accept=("units",)).laws


@pytest.mark.usefixtures("few_laws")
def test_a_jump_is_no_wrong_unit():
    log = drive_log(1, 30)
    log.pose[log.time > 15, :2] += 300.0
    assert identify(log, GEOMETRY, method="drive").best == "icr_radius"


@pytest.mark.usefixtures("few_laws")
def test_short_drives_and_reversed_ones_are_used_if_the_user_insists():
    logs = [drive_log(1, 20), replace(drive_log(2, 20).between(0, 30), run="short")]
    found = identify(logs, GEOMETRY, method="drive")
    assert len(found.drive.drives) == 1
    assert any("--accept short insists" in line for line in found.warnings)
    assert len(identify(logs, GEOMETRY, method="drive", accept=("short",)).drive.drives) == 2
    swapped = replace(logs[0], omega=logs[0].omega[:, ::-1])
    with pytest.raises(LogError, match=r"turns against its sprockets.*--accept signs insists"):
        identify(swapped, GEOMETRY, method="drive")
    with pytest.raises(InvalidValueError, match=r"accept = \('sign',\): must be among headings, outliers"):
        identify(swapped, GEOMETRY, accept=("sign",))


def test_outliers_and_implausible_rows_are_used_if_the_user_insists():
    twist = np.array([[0.1, 0.1 / radius] for radius in (0.6, -0.8, 1.2, -1.5, 2.0, -3.0, 0.5, -0.7)])
    omega = ICR.sprocket_speeds(twist, GEOMETRY)
    speeds = np.concatenate([omega, omega[:1] * 8])
    logs = [_circle(f"run {k}", one, twist[k % len(twist)]) for k, one in enumerate(speeds)]
    found = identify(logs, GEOMETRY, method="steady")
    assert len(found.samples) == 8
    assert any("slip 0.8" in line and "--accept units insists" in line for line in found.warnings)
    assert len(identify(logs, GEOMETRY, method="steady", accept=("units", "outliers")).samples) == 9


def _circle(name, omega, twist):
    time = np.arange(0.0, 10.0, 0.1)
    phi = twist[1] * time
    pose = np.column_stack([np.sin(phi), 1 - np.cos(phi), phi]) * [twist[0] / twist[1], twist[0] / twist[1], 1.0]
    return RunLog(name, time, np.tile(omega, (len(time), 1)), pose)
