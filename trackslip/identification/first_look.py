"""A first look at drives, before any law is fitted: clocks, units, sides, gains, and what the driving can tell.

What can't be used is refused in one line that names the quantity, its value and what to do. All else is reported as it
is: a gain far from 1 is no error, as wheels may slip on ice or be smaller than thought.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np

from trackslip.errors import LogError
from trackslip.identification.clocks import NEAR, Clock, clock_of_drive, median_offset
from trackslip.identification.fitted import FEWEST_BLOCKS, Gain
from trackslip.identification.gains import Gains, Steps, gains_of, windows_of
from trackslip.identification.jumps import without_jumps
from trackslip.identification.misread import (
    matches_of,
    refuse_angles,
    refuse_cells,
    refuse_degrees,
    refuse_headings,
    refuse_sides,
    refuse_units,
)
from trackslip.identification.preparation import BLOCK, PreparedDrive
from trackslip.kinematics import RobotGeometry

_DOUBTFUL = 0.5  # correlation of wheels and poses below which it is doubtful that they belong together


@dataclass(frozen=True)
class Alarm:
    """Something that a user must know before trusting any law."""

    kind: str  # a word: match, units or little
    line: str


@dataclass(frozen=True)
class Look:
    """What drives show before any law is fitted."""

    gains: Gains  # measured distances and turns over those of the wheels, and the sensor's rough place
    clock: float  # encoder clock minus pose clock at which both fit best, a start value [s]
    left_turns: float  # sum of turns to the left [rad]
    right_turns: float
    straight: float  # distance driven with little turning [m]
    top_speed: float  # mean over 2 s [m/s]
    duration: float  # of all drives with poses [s]
    notes: tuple[str, ...] = ()  # what the log is, one line each
    alarms: tuple[Alarm, ...] = ()

    @property
    def speed(self) -> Gain | None:
        """Measured distance over that of the wheels; None where no distance can be told."""
        return self.gains.speed

    @property
    def turn(self) -> Gain | None:
        """Measured turn over that of the wheels; None where no turn can be told."""
        return self.gains.turn

    def to_json(self) -> dict[str, Any]:
        """As plain numbers and texts; NaN is None."""
        content = {field.name: getattr(self, field.name) for field in fields(self) if field.name != "gains"}
        content["alarms"] = [vars(alarm) for alarm in self.alarms]
        return content | {key: gain and gain.to_json() for key, gain in (("speed", self.speed), ("turn", self.turn))}

    def without_jumps(
        self, drives: Sequence[PreparedDrive], geometry: RobotGeometry
    ) -> tuple[list[PreparedDrive], list[str]]:
        """The drives without wild poses, cut at lasting jumps, and a line on each kind of each drive."""
        cut = [without_jumps(drive, geometry, self.gains, self.clock) for drive in drives]
        return [part for parts, _ in cut for part in parts], [line for _, lines in cut for line in lines]


def first_look(drives: Sequence[PreparedDrive], geometry: RobotGeometry) -> Look:
    """Look at drives; raises LogError, with one line that says what to do, where the log can't be used."""
    for drive in drives:
        refuse_cells(drive)
    refuse_angles(drives, geometry)
    clock = median_offset([_checked_clock(drive) for drive in drives])
    covered = [drive for drive in drives if len(Steps.of(drive, geometry, clock).time) > 1]
    if not covered:
        raise LogError(f"run {drives[0].name!r}: encoders were read at fewer than 2 of its poses: record both together")
    refuse_degrees(covered, geometry, clock)
    for drive in covered:
        refuse_headings(drive, geometry, clock)
    refuse_sides(covered, geometry, clock)
    gains = gains_of(covered, geometry, clock)
    refuse_units(gains, geometry)
    speed, turn = gains.factors
    window = windows_of(covered, geometry, clock, turn)
    turns, distance = np.nan_to_num(window.turn), np.abs(speed * window.distance)
    look = Look(
        gains,
        clock,
        left_turns=float(turns.clip(min=0.0).sum()),
        right_turns=float((-turns).clip(min=0.0).sum()),
        straight=float(distance[np.abs(turns) * geometry.half_gauge < 0.1 * distance].sum()),
        top_speed=float((distance / window.duration).max(initial=0.0)),
        duration=float(sum(drive.time[-1] - drive.time[0] for drive in covered)),
    )
    return replace(look, notes=tuple(_notes(covered, look)), alarms=tuple(_alarms(covered, look, matches_of(window))))


def _checked_clock(drive: PreparedDrive) -> Clock:
    """The clock of a drive, if encoders and poses are of one time to within what a fit finds."""
    clock = clock_of_drive(drive)
    ahead, differ = ("pose" if clock.offset < 0 else "encoder"), abs(clock.offset)
    if clock.distinct and differ > NEAR:
        raise LogError(
            f"run {drive.name!r}: the clocks differ by {differ:.1f} s, as the {ahead} clock is ahead: subtract that "
            f"from the times of the {ahead}s"
        )
    time = np.sort(drive.time if drive.beyond is None else np.append(drive.time, drive.beyond[:, 0]))
    if time[0] > drive.edges[-1] + NEAR or time[-1] < drive.edges[0] - NEAR:
        raise LogError(
            f"run {drive.name!r}: encoders (t = {drive.edges[0]:.12g} to {drive.edges[-1]:.12g} s) and poses "
            f"({time[0]:.12g} to {time[-1]:.12g} s) don't overlap: subtract the difference of their clocks"
        )
    return clock


def _alarms(drives: Sequence[PreparedDrive], look: Look, matches: Sequence[float]) -> list[Alarm]:
    """Lines on what makes any law doubtful."""
    lines = list[tuple[str, str]]()
    match = float(np.mean(np.abs(matches))) if matches else 1.0
    if match < _DOUBTFUL:
        lines.append(
            ("match", f"wheels and poses hardly go together (correlation {match:.2f}): are they of one drive?")
        )
    for gain, what, unit in ((look.speed, "move", "x and y"), (look.turn, "turn", "phi")):
        if gain is not None and not 0.1 <= abs(gain.value) <= 3.0:
            times = f"the poses {what} {gain.value:.3g} times as far as the wheels"
            lines.append(("units", f"{times}: check the units of {unit} and omega, and sprocket_radius"))
    if sum(int(drive.blocks(drive.time[-1:])[0]) + 1 for drive in drives) < FEWEST_BLOCKS:
        least = FEWEST_BLOCKS * BLOCK
        lines.append(("little", f"{look.duration:.0f} s of driving are too few for intervals: drive {least:.0f} s"))
    return [Alarm(*line) for line in lines]


def _notes(drives: Sequence[PreparedDrive], look: Look) -> list[str]:
    """What the log is."""
    notes = []
    headed, placed = (np.mean([np.isfinite(d.pose[:, k]).any() for d in drives]) for k in (2, 0))
    interval = float(np.median([drive.interval for drive in drives]))
    step = float(np.median(np.concatenate([np.diff(drive.edges) for drive in drives])))
    kind = "positions without headings" if headed == 0 else "headings without positions" if placed == 0 else "poses"
    notes.append(f"{kind} every {interval:.3g} s, encoders every {step:.3g} s")
    if 0 < headed < 1 or 0 < placed < 1:
        notes.append("some runs lack headings or positions")
    logged = sum(drive.logged for drive in drives)
    if repeated := sum(drive.repeated for drive in drives):
        notes.append(f"{repeated:,} of {logged:,} poses repeat the one before: each counts once")
    if between := sum(drive.interpolated for drive in drives):
        knots = sum(drive.logged - drive.repeated - drive.interpolated for drive in drives if drive.interpolated)
        notes.append(f"poses are interpolated: {knots:,} knots are used, {between:,} rows between them left out")
    if any(drive.held for drive in drives):
        notes.append("encoders are read less often than logged: held readings count once")
    turns = look.left_turns + look.right_turns
    if look.speed is None and placed:
        notes.append("gains of distances can't be told: the robot hardly drives, or poses are too rare")
    if look.turn is None:
        notes.append("gains of turns can't be told: the robot hardly turns, or poses are too rare")
    elif min(look.left_turns, look.right_turns) < 0.1 * turns:
        side = "left" if look.left_turns > look.right_turns else "right"
        notes.append(f"turns to the {side} only: unequal sides can't be told from the turns")
    return notes
