"""A first look at drives, before any law is fitted: clocks, units, sides, gains, and what the
driving can determine.

Unusable logs are refused in one line that names the quantity, its value and a remedy. Other
findings are only reported: a gain far from 1 is no error, as wheels may slip on ice or be smaller
than assumed. Checks that can't be told from the log are reported, too. Drives are cut where their
poses jump.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from trackslip.drives.checks import Check, Verdict, unknown_lines
from trackslip.drives.clocks import GRID, NEAR, Clock, clock_of_drive, median_offset
from trackslip.drives.drive import BLOCK, Drive, Drives
from trackslip.drives.gains import WINDOW, Gains, Steps, gains_of
from trackslip.drives.jumps import without_jumps
from trackslip.drives.misread import (
    Matching,
    Ratios,
    counts_check,
    degrees_check,
    reading_checks,
    refuse_cells,
    signs_check,
    units_check,
)
from trackslip.errors import LogError
from trackslip.intervals import FEWEST_BLOCKS
from trackslip.kinematics import RobotGeometry
from trackslip.logs.repeats import Repeats
from trackslip.se2 import Mounting
from trackslip.viewable import ShortRepr

# gains of robots with their nominal gear and radius, and tracks or wheels on any ground but ice
_POSSIBLE_GAINS: Final = (0.1, 3.0)
# gains of distances, where poses are close enough that these are sure: half and twice may be
# mistaken radii (test_first_look)
_POSSIBLE_DISTANCES: Final = (0.6, 1.7)
# gains of distances if edges of ticks were counted otherwise than assumed: of one or both channels,
# rising or all
_EDGES: Final = (0.25, 0.5, 2.0, 4.0)
_NEARLY: Final = 0.1  # largest relative deviation from these: slip
# ratios of gains of turns to those of distances: a separation multiplier of 0.5 to 5; a wrong unit
# of x and y is beyond
_POSSIBLE_RATIOS: Final = (0.2, 2.0)
# relative difference of angles that matters, though poses may tell less
_UNCERTAIN_TURN: Final = 0.005
# relative scatter of the times between readings above which angles may be wrong by more than 1 %
_MOST_SCATTER: Final = 0.1
ONE_SIDED: Final = 0.1
"""Share of all turns below which turns to one side count as none."""


@dataclass(frozen=True)
class Alarm:
    """A warning that users must see before they trust a law."""

    kind: str  # one word, such as match, units or little
    line: str


@dataclass(frozen=True, repr=False)
class Look(ShortRepr):
    """Findings from drives before any law is fitted."""

    drives: tuple[Drive, ...]  # without wild poses, cut at lasting jumps
    # ratios of measured distances and turns to the wheels', and the sensor's approximate place
    gains: Gains
    clock: float  # encoder clock minus pose clock for the best match, a start value for fits [s]
    left_turns: float  # sum of all turns to the left [rad]
    right_turns: float  # sum of all turns to the right, as a positive angle [rad]
    duration: float  # total duration of the drives with poses [s]
    checks: tuple[Check, ...]  # verdicts on clocks, sides, directions, units and counts
    notes: tuple[str, ...]  # remarks on the log, one line each
    alarms: tuple[Alarm, ...]

    @property
    def turns_to_one_side(self) -> bool:
        """True if the robot turns to one side only, or hardly turns."""
        both = self.left_turns + self.right_turns
        return min(self.left_turns, self.right_turns) <= ONE_SIDED * both

    def to_json(self) -> dict[str, Any]:
        """The fields, except `drives`, as plain numbers and strings, with None for NaN."""
        return {
            "clock": self.clock,
            "left_turns": self.left_turns,
            "right_turns": self.right_turns,
            "duration": self.duration,
            "checks": {
                check.subject: {"verdict": check.verdict.value, "line": check.line}
                for check in self.checks
            },
            "notes": self.notes,
            "alarms": [vars(alarm) for alarm in self.alarms],
            "speed": self.gains.speed and self.gains.speed.to_json(),
            "turn": self.gains.turn and self.gains.turn.to_json(),
        }


def first_look(
    drives: Sequence[Drive], geometry: RobotGeometry, sensor: Mounting | None = None
) -> Look:
    """Inspect drives; raises LogError, with a one-line remedy, if the log can't be used.

    All checks are of the robot's headings. Those of a sensor that is known to be mounted turned
    differ from them by its yaw.
    """
    yaw = 0.0 if sensor is None else sensor.yaw
    drives = [drive.turned(-yaw) for drive in drives]
    for drive in drives:
        refuse_cells(drive)

    # clocks first: all other checks compare wheels and poses at the same times
    clocks = [clock_of_drive(drive) for drive in drives]
    for drive, own in zip(drives, clocks, strict=True):
        _refuse_clock(drive, own)
    clock = median_offset(clocks)
    covered = _with_readings(drives, geometry, clock)

    # sides, directions, units and counts
    gains = gains_of(Drives.of(covered), geometry, clock)
    matching = Matching.of(covered, geometry, clock)
    checks = [
        _clock_check(drives, clocks, matching),
        degrees_check(covered, matching, gains),
    ]
    _refuse(checks)
    checks += reading_checks(covered, matching, geometry, clock)
    _refuse(checks)
    ratios = Ratios.of(matching, gains)
    checks += [
        units_check(covered, matching, ratios, geometry),
        counts_check(covered, ratios.speed),
        signs_check(covered, matching),
        _readings_check(covered, gains),
    ]
    _refuse(checks)

    # parts between jumps
    cut = [without_jumps(drive, geometry, gains, clock) for drive in drives]
    parts = tuple(part for kept, _ in cut for part in kept)
    if not parts:
        raise LogError(
            f"run {drives[0].name!r}: its poses jump so often that too few lie between jumps"
        )
    checks += [
        _match_check(Matching.of(parts, geometry, clock)),
        _scale_check(ratios, matching, checks),
    ]
    left, right = _turns(covered, gains, geometry)
    duration = float(sum(drive.time[-1] - drive.time[0] for drive in covered))
    notes = [
        *_notes(covered, gains, matching, left, right),
        *unknown_lines(checks),
        *_clock_notes(drives, clocks, clock),
        *(line for _, lines in cut for line in lines),
    ]
    return Look(
        drives=tuple(part.turned(yaw) for part in parts),
        gains=gains,
        clock=clock,
        left_turns=left,
        right_turns=right,
        duration=duration,
        checks=tuple(checks),
        notes=tuple(notes),
        alarms=tuple(_alarms(checks, covered, duration)),
    )


def _refuse(checks: Sequence[Check]) -> None:
    """Raise LogError for the first check that fails so that the log can't be used."""
    for check in checks:
        if check.refuses:
            raise LogError(check.line)


def _with_readings(drives: Sequence[Drive], geometry: RobotGeometry, clock: float) -> list[Drive]:
    """The drives in which encoders were read at two poses or more; raises LogError if there are
    none.
    """
    steps = Steps.of(Drives.of(drives), geometry, clock)
    poses = np.bincount(steps.drive, minlength=len(drives))
    covered = [drive for drive, count in zip(drives, poses, strict=True) if count > 1]
    if not covered:
        raise LogError(
            f"run {drives[0].name!r}: encoders were read at fewer than 2 of its poses: record "
            "both together"
        )
    return covered


def _refuse_clock(drive: Drive, clock: Clock) -> None:
    """Raise LogError if encoders and poses are too far apart for fits to align them."""
    if clock.distinct and abs(clock.offset) > NEAR:
        ahead = "pose" if clock.offset < 0 else "encoder"
        raise LogError(
            f"run {drive.name!r}: the clocks differ by {abs(clock.offset):.1f} s, as the {ahead} "
            f"clock is ahead: subtract that from the times of the {ahead}s"
        )
    time = drive.time
    if drive.beyond is not None:
        time = np.append(time, drive.beyond[:, 0])
    begin, end = drive.edges[[0, -1]]
    first = float(time.min())
    last = float(time.max())
    if first > end + NEAR or last < begin - NEAR:
        raise LogError(
            f"run {drive.name!r}: encoders (t = {begin:.12g} to {end:.12g} s) and poses "
            f"({first:.12g} to {last:.12g} s) don't overlap: subtract the difference of their "
            "clocks"
        )


def _clock_check(drives: Sequence[Drive], clocks: Sequence[Clock], matching: Matching) -> Check:
    """Check that no other clock offset explains the motion as well, in the run that tells most."""
    subject = "clocks"
    if any(clock.checked for clock in clocks):
        return Check(subject, Verdict.HOLDS)
    reason = "the motion hardly varies"
    if matching.far is not None or matching.varies:
        reason = matching.why_unknown
    if max(len(drive.time) for drive in drives) <= 2:
        reason = matching.spacing
    return Check(subject, Verdict.UNKNOWN, reason)


def _clock_notes(drives: Sequence[Drive], clocks: Sequence[Clock], clock: float) -> list[str]:
    """A note on each run whose clocks are apart by another time than the usual one."""
    return [
        f"run {drive.name!r}: add {own.offset - clock:.2f} s to the times of its poses: other "
        "runs have other clocks"
        for drive, own in zip(drives, clocks, strict=True)
        if own.distinct and abs(own.offset - clock) > 2 * GRID
    ]


def _match_check(matching: Matching) -> Check:
    """Check that wheels and poses are of one drive."""
    subject = "match of wheels and poses"
    if matching.goes_together is None:
        return Check(subject, Verdict.UNKNOWN, matching.why_unknown)
    if matching.goes_together:
        return Check(subject, Verdict.HOLDS)
    if matching.far is not None:
        found = f"agree in {100 * matching.far.explained:.0f} % of motions between poses"
    else:
        found = f"correlation {float(np.abs(matching.matches).mean()):.2f}"
    line = f"wheels and poses hardly go together ({found}): are they of one drive?"
    return Check(subject, Verdict.FAILS, line, alarm="match")


def _readings_check(drives: Sequence[Drive], gains: Gains) -> Check:
    """Check that each encoder reading has a time of its own, where that changes the angles.

    Speeds that vary inversely with the time between readings are made from counts. If their
    readings are repeated, or the rows tell these times coarsely, the angles aren't known.
    """
    subject = "times of encoder readings"
    # between few ticks, speeds are the same for several readings
    told = [(drive.edges[1:], drive.omega) for drive in drives if not drive.by_ticks]
    repeats = Repeats.of(told)
    if repeats is None:
        return Check(subject, Verdict.HOLDS)
    if repeats.are_frequent and repeats.may_be_constant:
        return Check(subject, Verdict.UNKNOWN, "the sprockets turn at constant speeds")
    remedy = "log each reading once, with its own time, and leave cells empty in other rows"

    # which rows are readings
    known = _UNCERTAIN_TURN if gains.speed is None else gains.speed.error / gains.speed.value
    far = abs(repeats.difference) > max(_UNCERTAIN_TURN, known)
    if repeats.are_frequent and far and not repeats.are_held:
        line = (
            f"each encoder reading is repeated in {repeats.rows.mean():.2g} rows, and radii differ "
            f"by {100 * abs(repeats.difference):.2g} % with the row that counts: {remedy}"
        )
        return Check(subject, Verdict.FAILS, line, alarm="readings")

    # how exactly the times of readings are known
    if (repeats.are_before or repeats.are_held) and repeats.scatter > _MOST_SCATTER:
        line = (
            "the encoder speeds vary with the time between readings, which the rows tell to "
            f"{100 * repeats.scatter:.0f} % only: {remedy}"
        )
        return Check(subject, Verdict.FAILS, line, alarm="readings")
    return Check(subject, Verdict.HOLDS)


def _scale_check(ratios: Ratios, matching: Matching, checks: Sequence[Check]) -> Check:
    """Check that the gains of distances and of turns are possible, unless a unit is known to be
    wrong.

    Gains of turns that unequal radii may cause, on straight drives, tell nothing.
    """
    subject = "gains"
    known = any(check.verdict is Verdict.FAILS for check in checks)
    if matching.goes_together is False:  # gains of motions that aren't alike say nothing
        return Check(subject, Verdict.HOLDS)
    speed = ratios.speed
    turn = ratios.turn if matching.turns_tell else None
    possible = _POSSIBLE_DISTANCES if matching.far is None else _POSSIBLE_GAINS
    moves_wrong = speed is not None and not _is_within(speed, possible)
    turns_wrong = turn is not None and not _is_within(turn, _POSSIBLE_GAINS)
    if known or not (moves_wrong or turns_wrong):
        return Check(subject, Verdict.HOLDS)
    moves = [f"move {speed:.3g}"] if speed is not None else []
    turns = [f"turn {turn:.3g}"] if turn is not None else []
    # a wrong unit of omega changes both gains
    if speed is None:
        cause = "the units of phi and omega, the gear and half_gauge"
    elif turn is None:
        cause = "the units of x, y and omega, the gear and sprocket_radius"
    elif moves_wrong and _is_within(turn / speed, _POSSIBLE_RATIOS):
        cause = "the unit of omega, the gear and sprocket_radius"
        if any(abs(speed / factor - 1) < _NEARLY for factor in _EDGES):
            cause = (
                "the ticks per turn (4 times as many if all edges of both channels are counted), "
                + cause
            )
    elif moves_wrong:
        cause = "the unit of x and y, and sprocket_radius"
    else:
        cause = "the unit of phi, and half_gauge"
    both = " and ".join([*moves, *turns])
    line = f"the poses {both} times as far as the wheels: check {cause}"
    return Check(subject, Verdict.FAILS, line, alarm="units")


def _is_within(value: float, limits: tuple[float, float]) -> bool:
    """True if a value is from the lower to the upper limit."""
    low, high = limits
    return low <= value <= high


def _alarms(checks: Sequence[Check], drives: Sequence[Drive], duration: float) -> list[Alarm]:
    """Reasons to doubt any law fitted to the drives."""
    failed = [check for check in checks if check.verdict is Verdict.FAILS]
    alarms = [Alarm(check.alarm, check.line) for check in failed]
    blocks = sum(int(drive.blocks(drive.time[-1:])[0]) + 1 for drive in drives)
    if blocks < FEWEST_BLOCKS:
        least = FEWEST_BLOCKS * BLOCK
        line = f"{duration:.0f} s of driving are too few for intervals: drive {least:.0f} s"
        alarms.append(Alarm("little", line))
    return alarms


def _turns(drives: Sequence[Drive], gains: Gains, geometry: RobotGeometry) -> tuple[float, float]:
    """Sums of turns to the left and to the right, from the wheels and the gain of turns [rad].

    Turns are taken over windows, in which the noise of the encoders doesn't add up.
    """
    turns = [_turns_in_windows(drive, geometry) for drive in drives]
    turn = gains.factors[1] * np.concatenate(turns)
    return float(turn.clip(min=0.0).sum()), float((-turn).clip(min=0.0).sum())


def _turns_in_windows(drive: Drive, geometry: RobotGeometry) -> np.ndarray:
    """Turns (n,) of the wheels in successive windows [rad]."""
    grid = np.append(np.arange(drive.edges[0], drive.edges[-1], WINDOW), drive.edges[-1])
    left, right = drive.angles(grid) * geometry.sprocket_radius
    return np.diff(right - left) / (2 * geometry.half_gauge)


def _notes(
    drives: Sequence[Drive], gains: Gains, matching: Matching, left: float, right: float
) -> list[str]:
    """Remarks on the log's content; `left` and `right` are the sums of turns to each side [rad]."""
    headed = np.mean([np.isfinite(drive.pose[:, 2]).any() for drive in drives])
    placed = np.mean([np.isfinite(drive.pose[:, 0]).any() for drive in drives])
    interval = float(np.median([drive.interval for drive in drives]))
    step = float(np.median(np.concatenate([np.diff(drive.edges) for drive in drives])))
    kind = "poses"
    if headed == 0:
        kind = "positions without headings"
    elif placed == 0:
        kind = "headings without positions"
    notes = [f"{kind} every {interval:.3g} s, encoders every {step:.3g} s"]
    if 0 < headed < 1 or 0 < placed < 1:
        notes.append("some runs lack headings or positions")
    if repeated := sum(drive.repeated for drive in drives):
        notes.append(f"{repeated:,} repeated poses ignored")
    if between := sum(drive.interpolated for drive in drives):
        notes.append(f"{between:,} interpolated poses ignored")
    notes += [line for drive in drives for line in drive.notes]
    notes += _gain_notes(gains, matching, bool(placed))
    if gains.turn is not None and min(left, right) < ONE_SIDED * (left + right):
        side = "left" if left > right else "right"
        notes.append(f"turns to the {side} only: unequal sides and turns can't be told apart")
    return notes


def _gain_notes(gains: Gains, matching: Matching, placed: bool) -> list[str]:
    """Why gains of distances or of turns aren't known."""
    missing = list[str]()
    if gains.speed is None and placed:
        missing.append("distances")
    if gains.turn is None:
        missing.append("turns")
    if not missing:
        return []
    verb = {"distances": "drives", "turns": "turns"}
    if matching.far is not None or matching.evidence is None:
        return [f"no gains of {' and '.join(missing)}: {matching.spacing}"]
    return [f"no gain of {what}: the robot hardly {verb[what]}" for what in missing]
