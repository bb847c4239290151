"""Drives without wild poses, cut where poses jump for good, against dead reckoning."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np

from trackslip.errors import counted
from trackslip.identification.clocks import NEAR
from trackslip.identification.gains import Gains, Steps
from trackslip.identification.preparation import PreparedDrive
from trackslip.kinematics import Array, RobotGeometry
from trackslip.motion.jumps import MOST_WILD, find_jumps

_OUTLYING = 10.0  # robust standard deviations: slip in bursts reaches 6, relocalisations of a few cm exceed it


def without_jumps(
    drive: PreparedDrive, geometry: RobotGeometry, gains: Gains, clock: float
) -> tuple[list[PreparedDrive], list[str]]:
    """Parts of a drive without wild poses, cut at lasting jumps, and a line on each kind; parts of a few poses go."""
    wild, lasting = _jumps(drive, geometry, gains, clock)
    notes, cut = [], ": the drive is cut there"
    for rows, what, then in ((wild, "wild pose", ""), (lasting, "lasting jump", cut)):
        if len(rows):
            said = f"{counted(len(rows), what)} {'of its poses' if then else 'left out'}"
            notes.append(f"run {drive.name!r}: {said}, first at t = {drive.time[rows[0]]:.12g} s{then}")
    if not notes:
        return [drive], []
    good = np.ones(len(drive.time), bool)
    good[wild] = False
    parts = list[PreparedDrive]()
    for first, end in pairwise([0, *lasting.tolist(), len(drive.time)]):
        rows = np.flatnonzero(good[first:end]) + first
        if len(rows) > MOST_WILD and np.ptp(drive.angles(drive.time[rows[[0, -1]]] + clock), axis=1).any():
            parts.append(_part(drive, rows, clock))
    return parts, notes


def _jumps(drive: PreparedDrive, geometry: RobotGeometry, gains: Gains, clock: float) -> tuple[np.ndarray, np.ndarray]:
    """Indices of wild poses, and of the first pose after each lasting jump, against dead reckoning with gains.

    Wheels that slip altogether move nothing, and a stamp may be off by a step: so much of a motion is no jump.
    """
    steps = Steps.of(drive, geometry, clock, margin=NEAR)
    speed, turn = gains.factors
    heading = turn * (steps.turn - steps.turn[:1])
    ahead = np.exp(0.5j * (heading[1:] + heading[:-1]))
    path = np.append(0.0, np.cumsum(speed * np.diff(steps.distance) * ahead)) + gains.arm * np.exp(1j * heading)
    path = path * np.exp(-1j * gains.heading)
    driven = np.append(np.zeros((2, 1)), np.cumsum(np.abs(np.diff([speed * steps.distance, heading])), axis=1), axis=1)

    def missed(first: np.ndarray, then: np.ndarray) -> tuple[Array, Array]:
        size, by_wheels = np.zeros((2, len(first))), path[then] - path[first]
        if steps.heading is not None:
            size[1] = np.abs(steps.heading[then] - steps.heading[first] - heading[then] + heading[first])
        if steps.place is not None:
            moved = steps.place[then] - steps.place[first]
            size[0] = np.abs(np.abs(moved) - np.abs(by_wheels))
            if steps.heading is not None:
                size[0] = np.abs(moved - by_wheels * np.exp(1j * (steps.heading - heading)[first]))
        begin, end = np.maximum(first - 1, 0), np.minimum(then + 1, len(steps.time) - 1)
        return size, driven[:, end] - driven[:, begin]

    if len(steps.time) < 2:
        return steps.rows[:0], steps.rows[:0]
    step = np.arange(1, len(steps.time))
    harmless = np.array([0.3 * geometry.half_gauge, 0.2])  # [m, rad], under a robust loss
    limit = np.maximum(_OUTLYING * 1.4826 * np.median(missed(step - 1, step)[0], axis=1), harmless)
    wild, lasting = find_jumps(len(steps.time), missed, limit)
    return steps.rows[wild], steps.rows[lasting]


def _part(drive: PreparedDrive, rows: np.ndarray, clock: float) -> PreparedDrive:
    """The drive with these poses, and the encoder intervals within a few seconds of them."""
    first, last = drive.time[rows[[0, -1]]] + clock + np.array([-3.0, 3.0])
    begin = max(int(np.searchsorted(drive.edges, first)) - 1, 0)
    end = min(int(np.searchsorted(drive.edges, last)) + 1, len(drive.edges))
    pose = drive.pose[rows].copy()
    headed = np.isfinite(pose[:, 2])
    pose[headed, 2] = np.unwrap(pose[headed, 2])  # a wild heading may have added a turn
    return replace(
        drive, edges=drive.edges[begin:end], omega=drive.omega[begin : end - 1], time=drive.time[rows], pose=pose
    )
