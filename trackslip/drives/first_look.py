"""A first look at drives, before any law is fitted: clocks, units, sides, gains, and what the
driving can determine.

Unusable logs are refused in one line that names the quantity, its value and a remedy. Other
findings are only reported: a gain far from 1 is no error, as wheels may slip on ice or be smaller
than assumed. Drives are cut where their poses jump.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from trackslip.drives.clocks import GRID, NEAR, Clock, clock_of_drive, median_offset
from trackslip.drives.drive import BLOCK, Drive, Drives
from trackslip.drives.gains import Gains, Steps, gains_of, windows_of
from trackslip.drives.jumps import without_jumps
from trackslip.drives.misread import matches_of, refuse_cells, refuse_readings, refuse_units
from trackslip.errors import LogError
from trackslip.intervals import FEWEST_BLOCKS
from trackslip.kinematics import Array, RobotGeometry


@dataclass(frozen=True)
class Alarm:
    """A warning that users must see before they trust a law."""

    kind: str  # one word, such as match, units or little
    line: str


@dataclass(frozen=True)
class Look:
    """Findings from drives before any law is fitted."""

    drives: tuple[Drive, ...]  # without wild poses, cut at lasting jumps
    # ratios of measured distances and turns to the wheels', and the sensor's approximate place
    gains: Gains
    clock: float  # encoder clock minus pose clock for the best match, a start value for fits [s]
    left_turns: float  # sum of all turns to the left [rad]
    right_turns: float  # sum of all turns to the right, as a positive angle [rad]
    duration: float  # total duration of the drives with poses [s]
    notes: tuple[str, ...]  # remarks on the log, one line each
    alarms: tuple[Alarm, ...]

    def to_json(self) -> dict[str, Any]:
        """The fields, except `drives`, as plain numbers and strings, with None for NaN."""
        content = {
            name: value for name, value in vars(self).items() if name not in ("drives", "gains")
        }
        content["alarms"] = [vars(alarm) for alarm in self.alarms]
        gains = ("speed", self.gains.speed), ("turn", self.gains.turn)
        return content | {name: gain and gain.to_json() for name, gain in gains}


def first_look(drives: Sequence[Drive], geometry: RobotGeometry) -> Look:
    """Inspect drives; raises LogError, with a one-line remedy, if the log can't be used."""
    for drive in drives:
        refuse_cells(drive)
    clocks = [_checked_clock(drive) for drive in drives]
    clock = median_offset(clocks)
    poses = np.bincount(Steps.of(Drives.of(drives), geometry, clock).drive, minlength=len(drives))
    covered = [drive for drive, count in zip(drives, poses, strict=True) if count > 1]
    if not covered:
        raise LogError(
            f"run {drives[0].name!r}: encoders were read at fewer than 2 of its poses: record "
            "both together"
        )
    together = Drives.of(covered)
    gains = gains_of(together, geometry, clock)
    window = windows_of(together, geometry, clock)
    matches = matches_of(window)
    refuse_readings(covered, window, matches, geometry, clock)
    refuse_units(covered, gains, geometry)
    turns = gains.factors[1] * window.turn
    left, right = float(turns.clip(min=0.0).sum()), float((-turns).clip(min=0.0).sum())
    duration = float(sum(drive.time[-1] - drive.time[0] for drive in covered))
    cut = [without_jumps(drive, geometry, gains, clock) for drive in drives]
    parts = tuple(part for kept, _ in cut for part in kept)
    if not parts:
        raise LogError(
            f"run {drives[0].name!r}: its poses jump so often that too few lie between jumps"
        )
    others = [
        f"run {drive.name!r}: add {own.offset - clock:.2f} s to the times of its poses: other "
        "runs have other clocks"
        for drive, own in zip(drives, clocks, strict=True)
        if own.distinct and abs(own.offset - clock) > 2 * GRID
    ]
    return Look(
        parts,
        gains,
        clock,
        left,
        right,
        duration,
        (
            *_notes(covered, gains, left, right),
            *others,
            *(line for _, lines in cut for line in lines),
        ),
        tuple(
            _alarms(
                covered, gains, duration, matches_of(windows_of(Drives.of(parts), geometry, clock))
            )
        ),
    )


def _checked_clock(drive: Drive) -> Clock:
    """A drive's clock offset; raises LogError if encoders and poses are too far apart for fits to
    align them.
    """
    clock = clock_of_drive(drive)
    ahead, differ = ("pose" if clock.offset < 0 else "encoder"), abs(clock.offset)
    if clock.distinct and differ > NEAR:
        raise LogError(
            f"run {drive.name!r}: the clocks differ by {differ:.1f} s, as the {ahead} clock is "
            "ahead: subtract that "
            f"from the times of the {ahead}s"
        )
    time = np.sort(
        drive.time if drive.beyond is None else np.append(drive.time, drive.beyond[:, 0])
    )
    if time[0] > drive.edges[-1] + NEAR or time[-1] < drive.edges[0] - NEAR:
        raise LogError(
            f"run {drive.name!r}: encoders (t = {drive.edges[0]:.12g} to {drive.edges[-1]:.12g} "
            "s) and poses "
            f"({time[0]:.12g} to {time[-1]:.12g} s) don't overlap: subtract the difference of "
            "their clocks"
        )
    return clock


def _alarms(drives: Sequence[Drive], gains: Gains, duration: float, matches: Array) -> list[Alarm]:
    """Reasons to doubt any law fitted to the drives."""
    alarms = list[Alarm]()
    match = float(np.abs(matches).mean()) if len(matches) else 1.0
    if match < 0.5:
        line = (
            f"wheels and poses hardly go together (correlation {match:.2f}): are they of one drive?"
        )
        alarms.append(Alarm("match", line))
    for gain, what, unit in ((gains.speed, "move", "x and y"), (gains.turn, "turn", "phi")):
        if gain is not None and not 0.1 <= abs(gain.value) <= 3.0:
            times = f"the poses {what} {gain.value:.3g} times as far as the wheels"
            alarms.append(
                Alarm(
                    "units",
                    f"{times}: check the units of {unit} and omega, the gear and sprocket_radius",
                )
            )
    if (
        all(drive.whole for drive in drives)
        and gains.speed is not None
        and not 0.8 <= abs(gains.speed.value) <= 1.2
    ):
        what = (
            "omega_l and omega_r are whole numbers, and the poses move "
            f"{gains.speed.value:.3g} times as far"
        )
        alarms.append(
            Alarm(
                "units", f"{what}: of counts, omega is 2 pi counts / (counts per turn * their time)"
            )
        )
    if sum(int(drive.blocks(drive.time[-1:])[0]) + 1 for drive in drives) < FEWEST_BLOCKS:
        least = FEWEST_BLOCKS * BLOCK
        alarms.append(
            Alarm(
                "little",
                f"{duration:.0f} s of driving are too few for intervals: drive {least:.0f} s",
            )
        )
    return alarms


def _notes(drives: Sequence[Drive], gains: Gains, left: float, right: float) -> list[str]:
    """Remarks on the log's content; `left` and `right` are the sums of turns to each side [rad]."""
    headed, placed = (np.mean([np.isfinite(d.pose[:, k]).any() for d in drives]) for k in (2, 0))
    interval = float(np.median([drive.interval for drive in drives]))
    step = float(np.median(np.concatenate([np.diff(drive.edges) for drive in drives])))
    kind = (
        "positions without headings"
        if headed == 0
        else "headings without positions"
        if placed == 0
        else "poses"
    )
    notes = [f"{kind} every {interval:.3g} s, encoders every {step:.3g} s"]
    if 0 < headed < 1 or 0 < placed < 1:
        notes.append("some runs lack headings or positions")
    if repeated := sum(drive.repeated for drive in drives):
        notes.append(f"{repeated:,} poses repeat the one before: each counts once")
    if between := sum(drive.interpolated for drive in drives):
        notes.append(
            f"poses are interpolated: {between:,} rows between the measured ones are left out"
        )
    if any(drive.held for drive in drives):
        notes.append("encoders are read less often than logged: held readings count once")
    if gains.speed is None and placed:
        notes.append(
            "gains of distances can't be determined: the robot hardly drives, or poses are too rare"
        )
    if gains.turn is None:
        notes.append(
            "gains of turns can't be determined: the robot hardly turns, or poses are too rare"
        )
    elif min(left, right) < 0.1 * (left + right):
        side = "left" if left > right else "right"
        notes.append(
            f"turns to the {side} only: unequal sides can't be distinguished from the turns"
        )
    return notes
