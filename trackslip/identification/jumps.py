"""Jumps of poses: single wild ones, which come back, and lasting ones, as of a relocalisation or a placeholder."""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from trackslip.errors import counted
from trackslip.identification.clocks import NEAR
from trackslip.identification.gains import Gains, Steps
from trackslip.identification.preparation import PreparedDrive
from trackslip.kinematics import Array, RobotGeometry

MOST_WILD = 3
"""Successive poses that are wild, or placeholders, rather than a path of their own."""
_OUTLYING = 10.0  # robust standard deviations: slip in bursts reaches 6, relocalisations of a few cm exceed it
_LEAST = 0.3, 0.2  # jumps [half gauges, rad] that are smaller do no harm under a robust loss
_MANY = 0.1  # share of steps above which they are noise


@dataclass(frozen=True)
class Jumps:
    """Poses of a drive that jump."""

    wild: np.ndarray  # (J,) indices of single poses
    lasting: np.ndarray  # (L,) indices of the first pose after each lasting jump


def jumps_of(drive: PreparedDrive, geometry: RobotGeometry, gains: Gains, clock: float) -> Jumps:
    """Wild poses and lasting jumps, against dead reckoning by the wheels with gains."""
    none = Jumps(np.zeros(0, int), np.zeros(0, int))
    reckoning = _Reckoning(drive, geometry, gains, clock)
    if len(reckoning.time) < 5:
        return none
    step = np.arange(1, len(reckoning.time))
    missed, slip = reckoning.missed(step - 1, step)
    scale = 1.4826 * np.median(np.nan_to_num(missed), axis=1)
    least = np.array([_LEAST[0] * geometry.half_gauge, _LEAST[1]])
    limit = np.maximum(_OUTLYING * scale, least)[:, None]
    off = (missed - slip > limit).any(axis=0)
    if not off.any() or off.mean() > _MANY:
        return none
    wild, lasting = list[int](), list[int]()
    last = 0
    for k in map(int, np.flatnonzero(off) + 1):
        if k <= last:
            continue
        after = np.arange(k + 1, min(k + 1 + MOST_WILD, len(reckoning.time)))
        missed, slip = reckoning.missed(np.full(len(after), k - 1), after)
        back = ~(missed - slip > limit).any(axis=0)
        if back.any():
            last = int(after[np.argmax(back)])
            wild += range(k, last)
        else:
            lasting.append(k)
    return Jumps(reckoning.rows[wild], reckoning.rows[lasting])


def without_jumps(
    drive: PreparedDrive, geometry: RobotGeometry, gains: Gains, clock: float
) -> tuple[list[PreparedDrive], list[str]]:
    """Parts of a drive without wild poses, cut at lasting jumps, and a line on each kind; parts of a few poses go."""
    jumps = jumps_of(drive, geometry, gains, clock)
    if not len(jumps.wild) and not len(jumps.lasting):
        return [drive], []
    notes = []
    if len(jumps.wild):
        at = drive.time[jumps.wild[0]]
        notes.append(f"run {drive.name!r}: {counted(len(jumps.wild), 'wild pose')} left out, first at t = {at:.12g} s")
    if len(jumps.lasting):
        at = drive.time[jumps.lasting[0]]
        notes.append(
            f"run {drive.name!r}: {counted(len(jumps.lasting), 'lasting jump')} of its poses, first at t = {at:.12g} "
            "s: the drive is cut there"
        )
    kept = np.ones(len(drive.time), bool)
    kept[jumps.wild] = False
    edges = [0, *jumps.lasting.tolist(), len(drive.time)]
    parts = list[PreparedDrive]()
    for first, end in pairwise(edges):
        rows = np.flatnonzero(kept[first:end]) + first
        if len(rows) > MOST_WILD and _moves(drive, drive.time[rows[[0, -1]]] + clock):
            parts.append(_part(drive, rows, clock))
    return parts, notes


def _moves(drive: PreparedDrive, within: Array) -> bool:
    """True if the wheels turn at all between two times."""
    inside = (drive.edges[1:] > within[0]) & (drive.edges[:-1] < within[1])
    return bool(np.abs(drive.omega[inside]).max(initial=0.0) > 0)


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


class _Reckoning:
    """Dead reckoning by the wheels, with gains, beside the poses that encoders nearly cover."""

    def __init__(self, drive: PreparedDrive, geometry: RobotGeometry, gains: Gains, clock: float) -> None:
        steps = Steps.of(drive, geometry, clock, margin=NEAR)
        speed = gains.speed.value if gains.speed else 1.0
        turn = gains.turn.value if gains.turn else 1.0
        self.time, self.rows, self._place, self._measured = steps.time, steps.rows, steps.place, steps.heading
        self._heading = np.append(0.0, np.cumsum(turn * steps.turn))
        middle = (self._heading[1:] + self._heading[:-1]) / 2 - gains.heading
        self._path = np.append(0.0, np.cumsum(speed * steps.distance * np.exp(1j * middle)))
        self._path = self._path + gains.arm * np.exp(1j * (self._heading - gains.heading))
        self._driven = np.append(0.0, np.cumsum(np.abs(speed * steps.distance)))
        self._turned = np.append(0.0, np.cumsum(np.abs(turn * steps.turn)))

    def missed(self, first: np.ndarray, then: np.ndarray) -> tuple[Array, Array]:
        """By how much motions between poses (n,) miss dead reckoning, (2, n) [m, rad], and by how much slip can.

        NaN where not measured. Wheels that slip altogether move nothing, and a stamp may be off by a step.
        """
        missed = np.full((2, len(first)), np.nan)
        begin, end = np.maximum(first - 1, 0), np.minimum(then + 1, len(self.time) - 1)
        slip = np.stack([values[end] - values[begin] for values in (self._driven, self._turned)])
        if self._measured is not None:
            turned, by_wheels = (values[then] - values[first] for values in (self._measured, self._heading))
            missed[1] = np.abs(turned - by_wheels)
        if self._place is not None:
            moved, by_wheels = (values[then] - values[first] for values in (self._place, self._path))
            if self._measured is None:
                missed[0] = np.abs(np.abs(moved) - np.abs(by_wheels))
            else:
                missed[0] = np.abs(moved - by_wheels * np.exp(1j * (self._measured - self._heading)[first]))
        return missed, slip
