"""Jumps of poses: motions that neither the wheels nor their slip explain.

Poses that leave the wheels' path and soon return are wild and left out. Where poses stay off it, as
after a relocalisation, the drive is cut.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise
from typing import Final

import numpy as np

from trackslip.drives.clocks import NEAR
from trackslip.drives.drive import Drive, Drives
from trackslip.drives.gains import Gains, Steps
from trackslip.errors import counted
from trackslip.intervals import DEVIATION_PER_MEDIAN
from trackslip.kinematics import Array, RobotGeometry

# most successive poses that may be wild or placeholders; a longer series is a path of its own
MOST_WILD: Final = 3
# largest share of outlying motions; above it, all outliers count as noise
_MOST_OUTLYING: Final = 0.1
# limit for jumps [robust standard deviations]: bursts of slip reach 6, relocalisations exceed 10
_OUTLYING: Final = 10.0
# deviations that are harmless, because a robust loss takes them [half gauges, rad]
_HARMLESS: Final = (0.3, 0.2)
_AROUND: Final = 3.0  # time by which encoders continue beyond the poses of a part [s]


@dataclass(frozen=True)
class Deviations:
    """Deviations of motions from the wheels' path, and what slip explains of them."""

    size: Array  # (2, n) deviations in place and heading [m, rad]
    by_slip: Array  # (2, n) largest deviations that slip explains [m, rad]

    def outlying(self, limit: Array) -> np.ndarray:
        """(n,) bool: true where slip leaves more than `limit` (2,) unexplained [m, rad]."""
        return np.asarray((self.size - self.by_slip > limit[:, None]).any(axis=0))


DeviationsOf = Callable[[np.ndarray, np.ndarray], Deviations]
"""Maps the indices (n,) of the first and of the last poses of n motions to their deviations."""


@dataclass(frozen=True)
class Jumps:
    """Jumps in a series of poses."""

    wild: np.ndarray  # indices of poses that leave the path and soon return
    lasting: np.ndarray  # indices of the first pose after each lasting jump


def find_jumps(count: int, deviations: DeviationsOf, limit: Array) -> Jumps:
    """Find the jumps among `count` poses.

    A motion isn't a jump if slip explains its deviation to within `limit` (2,) [m, rad].
    """
    step = np.arange(1, count)
    outlying = step[deviations(step - 1, step).outlying(limit)]
    if len(outlying) > max(1, _MOST_OUTLYING * count):
        outlying = outlying[:0]

    wild = list[int]()
    lasting = list[int]()
    last = 0  # the pose at which the path is found again
    for k in outlying.tolist():
        if k <= last:
            continue
        # the poses soon after that fit to the last good pose
        after = np.arange(k + 1, min(k + 1 + MOST_WILD, count))
        before = np.full(len(after), k - 1)
        back = after[~deviations(before, after).outlying(limit)]
        if back.size:
            last = int(back[0])
            wild += range(k, last)
        else:
            lasting.append(k)
    return Jumps(np.array(wild, int), np.array(lasting, int))


def without_jumps(
    drive: Drive, geometry: RobotGeometry, gains: Gains, clock: float
) -> tuple[list[Drive], list[str]]:
    """Drop wild poses and cut the drive at lasting jumps; returns all parts that are long enough,
    and notes.

    `gains` are those of the wheels, and `clock` is the encoder clock minus the pose clock [s].
    """
    jumps = jumps_of(drive, geometry, gains, clock)
    notes = _notes(drive, jumps)
    if not notes:
        return [drive], []

    good = np.ones(len(drive.time), bool)
    good[jumps.wild] = False
    parts = list[Drive]()
    for first, end in pairwise([0, *jumps.lasting.tolist(), len(drive.time)]):
        rows = np.flatnonzero(good[first:end]) + first
        if len(rows) <= MOST_WILD:
            continue
        begin = float(drive.time[rows[0]])
        last = float(drive.time[rows[-1]])
        part = drive.with_poses(rows).cut(begin, last, clock, _AROUND)
        turned = part.angles(part.time[[0, -1]] + clock)
        if np.ptp(turned, axis=1).any():
            parts.append(part)
    return parts, notes


def _notes(drive: Drive, jumps: Jumps) -> list[str]:
    """A line on wild poses and one on lasting jumps, if there are any."""
    notes = list[str]()
    if len(jumps.wild):
        first = f"first at t = {drive.time[jumps.wild[0]]:.12g} s"
        notes.append(
            f"run {drive.name!r}: {counted(len(jumps.wild), 'wild pose')} left out, {first}"
        )
    if len(jumps.lasting):
        first = f"first at t = {drive.time[jumps.lasting[0]]:.12g} s: the drive is cut there"
        notes.append(
            f"run {drive.name!r}: {counted(len(jumps.lasting), 'lasting jump')} of its poses, "
            f"{first}"
        )
    return notes


def jumps_of(drive: Drive, geometry: RobotGeometry, gains: Gains, clock: float) -> Jumps:
    """Jumps in a drive's poses, judged by dead reckoning with gains.

    A deviation isn't a jump if complete slip of the wheels or a stamp that is off by one step can
    explain it. Without headings, only the lengths of motions are compared.
    """
    steps = Steps.of(Drives.of([drive]), geometry, clock, margin=NEAR)
    if len(steps.time) < 2:
        return Jumps(steps.rows[:0], steps.rows[:0])
    speed, turn = gains.factors

    # the sensor's path by the wheels, in the frame in which the sensor sees itself
    heading = turn * (steps.turn - steps.turn[:1])
    ahead = np.exp(0.5j * (heading[1:] + heading[:-1]))
    place = np.append(0.0, np.cumsum(speed * np.diff(steps.distance) * ahead))
    path = (place + gains.arm * np.exp(1j * heading)) * np.exp(-1j * gains.heading)

    # distance and turn of the wheels, whatever their signs, up to each pose
    sizes = np.abs(np.diff([speed * steps.distance, heading]))
    driven = np.append(np.zeros((2, 1)), np.cumsum(sizes, axis=1), axis=1)

    def deviations(first: np.ndarray, last: np.ndarray) -> Deviations:
        by_wheels = path[last] - path[first]
        moved = steps.place[last] - steps.place[first]
        if np.isnan(steps.heading).any():
            aside = np.abs(np.abs(moved) - np.abs(by_wheels))
        else:
            frame = np.exp(1j * (steps.heading - heading)[first])
            aside = np.abs(moved - by_wheels * frame)
        by_wheels_turned = heading[last] - heading[first]
        turned = np.abs(steps.heading[last] - steps.heading[first] - by_wheels_turned)
        # a step earlier and later: stamps may be off by one
        begin = np.maximum(first - 1, 0)
        end = np.minimum(last + 1, len(steps.time) - 1)
        return Deviations(np.nan_to_num([aside, turned]), driven[:, end] - driven[:, begin])

    step = np.arange(1, len(steps.time))
    usual = DEVIATION_PER_MEDIAN * np.median(deviations(step - 1, step).size, axis=1)
    harmless = np.array(_HARMLESS) * [geometry.half_gauge, 1.0]
    jumps = find_jumps(len(steps.time), deviations, np.maximum(_OUTLYING * usual, harmless))
    return Jumps(steps.rows[jumps.wild], steps.rows[jumps.lasting])
