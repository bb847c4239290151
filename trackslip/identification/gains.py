"""Gains: how far a robot moves and turns per metre and radian of its wheels, by robust regression over windows.

This is what people compute by hand: the distance measured over that of the wheels, the turn measured over that of the
wheels. Without headings, the turn is that between successive chords of the path.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from trackslip.identification.fitted import Gain, cr3, student
from trackslip.identification.preparation import PreparedDrive
from trackslip.kinematics import Array, RobotGeometry, body_twist, wrap_angle

WINDOW = 2.0
"""Duration of windows [s]: noise of 2 cm is 5 % of the distance of a slow robot then, and steady arcs stay below half a
turn."""
_OFF = 0.1  # error of the clock that is allowed for [s]: the step of its grid
_HUBER = 1.345  # standard deviations: 95 % efficient for normal errors (P. J. Huber, *Robust Statistics*)
_TURNS = np.concatenate([-np.geomspace(0.05, 3.0, 25), np.geomspace(0.05, 3.0, 25)])  # gains tried to start from


@dataclass(frozen=True)
class Gains:
    """Of distances and turns; None where the driving doesn't tell."""

    speed: Gain | None
    turn: Gain | None
    heading: float = 0.0  # direction of forward motion in the frame of the headings [rad]; 0 without headings
    arm: complex = 0j  # place of the sensor in the robot, x + i y [m]; 0 without headings

    @property
    def factors(self) -> tuple[float, float]:
        """Of distances and turns; 1 where the driving doesn't tell."""
        return self.speed.value if self.speed else 1.0, self.turn.value if self.turn else 1.0

    def law(self, geometry: RobotGeometry) -> dict[str, float]:
        """The gains as constant ICRs: (1 + ε) on the speed, (1 + ε) b / (b + D) on the yaw rate."""
        speed = self.factors[0]
        turn = self.turn.value if self.turn else speed
        return {"offset": geometry.half_gauge * (speed / turn - 1), "radius_error": speed - 1}

    def start(self, geometry: RobotGeometry, clock: float) -> dict[str, float]:
        """Values to start fits from, by name, with a clock offset [s]; of the law only if distances are known."""
        place = {"sensor_x": self.arm.real, "sensor_y": self.arm.imag, "sensor_yaw": self.heading}
        return (self.law(geometry) if self.speed else {}) | place | {"clock_offset": clock}


class Window(NamedTuple):
    """Motion in windows of drives, n in all."""

    distance: Array  # (n,) by the wheels [m]
    turn: Array  # (n,) by the wheels [rad]
    moved: np.ndarray  # (n,) measured in the frame of the sensor, complex; without headings, the chord's size [m]
    turned: Array  # (n,) measured [rad]; without headings, from this chord to the next one; NaN where not known
    block: np.ndarray  # (n,) index of the block of driving
    duration: Array  # (n,) [s]


@dataclass(frozen=True)
class Steps:
    """The poses of a drive that encoders cover, and what the wheels have driven until each."""

    time: Array  # (K,) of the poses, pose clock [s]
    place: np.ndarray | None  # (K,) complex [m]
    heading: Array | None  # (K,) [rad], interpolated to positions where both exist
    distance: Array  # (K,) by the wheels [m]
    turn: Array  # (K,) by the wheels [rad]
    rows: np.ndarray  # (K,) indices of the poses in the drive

    @classmethod
    def of(
        cls, drive: PreparedDrive, geometry: RobotGeometry, clock: float, shift: float = 0.0, margin: float = 0.0
    ) -> Steps:
        """The steps by wheels `shift` [s] later than by this clock; wheels go on at both ends for `margin` [s]."""
        placed, headed = np.isfinite(drive.pose[:, 0]), np.isfinite(drive.pose[:, 2])
        rows = placed if placed.sum() > 1 else headed
        at, ends = drive.time + clock, drive.edges[[0, -1]] + [-margin - 1e-9, margin + 1e-9]
        rows = np.flatnonzero(rows & (at >= ends[0]) & (at <= ends[1]))
        left, right = geometry.sprocket_radius * _going_on(drive, margin).angles(at[rows] + shift)
        return cls(
            drive.time[rows],
            drive.pose[rows, 0] + 1j * drive.pose[rows, 1] if placed.sum() > 1 else None,
            np.interp(drive.time[rows], drive.time[headed], drive.pose[headed, 2]) if headed.sum() > 1 else None,
            (left + right) / 2,
            (right - left) / (2 * geometry.half_gauge),
            rows,
        )

    @property
    def moved(self) -> np.ndarray:
        """(K - 1,) Measured motion along the arc, in the frame of the headings, complex [m]; NaN without places."""
        assert self.heading is not None
        if self.place is None:
            return np.full(len(self.time) - 1, np.nan + 0j)
        turn = np.diff(self.heading)
        chord = np.diff(self.place) * np.exp(-0.5j * (self.heading[1:] + self.heading[:-1]))
        return chord / np.maximum(np.sinc(turn / (2 * np.pi)), 0.1)

    def ends(self, length: float) -> np.ndarray:
        """Poses (n + 1,) that bound windows of about this duration [s]."""
        if len(self.time) < 2:
            return np.zeros(0, int)
        cuts = np.arange(self.time[0], self.time[-1] + length / 2, length)
        return np.unique(np.searchsorted(self.time, cuts - 1e-9).clip(max=len(self.time) - 1))


def _going_on(drive: PreparedDrive, margin: float) -> PreparedDrive:
    """The drive, whose wheels go on at their first and last speeds for a while [s]."""
    edges = drive.edges.copy()
    edges[[0, -1]] += -margin - 1e-9, margin + 1e-9
    return replace(drive, edges=edges)


def reckoned(drive: PreparedDrive, geometry: RobotGeometry, ratio: float, time: Array) -> np.ndarray:
    """Complex places (n,) at encoder times by the wheels alone, with their turns scaled [m]."""
    v, w = body_twist(drive.omega, 0.0, geometry).T
    step = np.diff(drive.edges)
    heading = np.append(0.0, np.cumsum(ratio * w * step))
    place = np.append(0.0, np.cumsum(v * step * np.exp(0.5j * (heading[1:] + heading[:-1]))))
    return np.interp(time, drive.edges, place)


def windows_of(
    drives: Sequence[PreparedDrive],
    geometry: RobotGeometry,
    clock: float,
    turn_gain: float = 1.0,
    shift: float = 0.0,
    length: float = WINDOW,
) -> Window:
    """Motion of drives in windows, by wheels with this gain of turns, `shift` [s] later than by this clock.

    Without headings, distances and turns are those of chords. `length` is the duration of the windows, at least [s].
    """
    parts, first = [], 0
    for drive in drives:
        part = _windows(drive, geometry, clock, turn_gain, shift, length)
        parts.append(part._replace(block=part.block + first))
        first += int(part.block.max(initial=-1)) + 1
    return Window(*map(np.concatenate, zip(*parts, strict=True)))


def _windows(
    drive: PreparedDrive, geometry: RobotGeometry, clock: float, turn_gain: float, shift: float, length: float
) -> Window:
    steps, length = Steps.of(drive, geometry, clock, shift), max(length, 2 * drive.interval)
    ends = steps.ends(length)
    if len(ends) < 2:
        none = np.zeros(0)
        return Window(none, none, none + 0j, none, none.astype(int), none)
    lost = (np.diff(steps.time) > 10.0) | (np.abs(np.diff(steps.turn)) > np.pi)
    duration = np.diff(steps.time[ends])
    good = (np.diff(np.append(0, np.cumsum(lost))[ends]) == 0) & (duration > 0.49 * length)
    block = drive.blocks((steps.time[ends[1:]] + steps.time[ends[:-1]]) / 2)
    distance, turn = np.diff(steps.distance[ends]), turn_gain * np.diff(steps.turn[ends])
    if steps.heading is not None:
        turned, moved = np.diff(steps.heading[ends]), np.diff(np.append(0.0, np.cumsum(steps.moved))[ends])
    else:
        assert steps.place is not None
        chord = np.diff(steps.place[ends])
        by_wheels = np.diff(reckoned(drive, geometry, turn_gain, steps.time[ends] + clock))
        distance, moved = np.abs(by_wheels), np.abs(chord) + 0j
        turned, turn = (np.append(np.angle(way[1:] * np.conj(way[:-1])), np.nan) for way in (chord, by_wheels))
        moving = (np.abs(chord) > 0.3 * rms(chord)) & (distance > 0.3 * rms(distance)) & good
        turned[~(moving & np.append(moving[1:], False))] = np.nan
    return Window(distance, turn, np.where(good, moved, np.nan), np.where(good, turned, np.nan), block, duration)


def gains_of(drives: Sequence[PreparedDrive], geometry: RobotGeometry, clock: float) -> Gains:
    """Gains of drives with poses all of one kind."""
    headed = [drive for drive in drives if drive.has_heading]
    if not headed:
        return _of_positions(drives, geometry, clock)
    before, window, after = (windows_of(headed, geometry, clock, shift=shift) for shift in (-_OFF, 0.0, _OFF))
    late = np.column_stack([after.distance - before.distance, after.turn - before.turn]) / (2 * _OFF)
    turn = speed = None
    heading, arm = 0.0, 0j
    known = np.isfinite(window.turned)
    if _tells(window.turn[known], 0.1):
        fit = _regression(np.column_stack([window.turn, late[:, 1]]), window.turned, window, known, (0.0, _OFF**-2))
        turn = _gain(fit.values[0], fit.without[:, 0], fit.quantile)
    known &= np.isfinite(window.moved)
    if _tells(window.distance[known], 0.2 * geometry.half_gauge):
        aside = (2 * geometry.half_gauge) ** -2  # of the sensor
        if _collinear(window.distance[known], window.turned[known]):
            aside = 1e12  # an offset to the side looks like a gain
        columns = np.column_stack([window.distance, window.turned, late[:, 0]])
        fit = _regression(columns, window.moved, window, known, (0.0, aside, _OFF**-2))
        along, across, _ = fit.values
        ahead = along / abs(along) * (-1.0 if along.real < 0 else 1.0)
        speed = _gain((along / ahead).real, (fit.without[:, 0] / ahead).real, fit.quantile)
        heading, arm = float(-np.angle(ahead)), complex(across / 1j / ahead)
    return Gains(speed, turn, heading, arm)


def _of_positions(drives: Sequence[PreparedDrive], geometry: RobotGeometry, clock: float) -> Gains:
    """Gains of drives whose poses have no headings: chords don't depend linearly on the gain of turns."""

    def missed(turn_gain: float) -> tuple[Array, Window]:
        window = windows_of(drives, geometry, clock, turn_gain)
        return np.nan_to_num(wrap_angle(window.turned - window.turn)), window

    sizes = [float(np.minimum(np.abs(missed(gain)[0]), 1.0).sum()) for gain in _TURNS]
    value, turn = float(_TURNS[int(np.argmin(sizes))]), None
    for _ in range(6 if np.ptp(sizes) > 1e-9 else 0):
        change = 1e-3
        off, window = missed(value)
        slope = -wrap_angle(missed(value + change)[0] - off) / change
        used = (np.abs(slope) > 0) & np.isfinite(window.turned)
        if not used.any():
            break
        fit = _regression(slope[:, None], off, window, used, (0.0,))
        step = float(np.clip(fit.values[0], -0.3, 0.3))
        turn = _gain(value + step, value + fit.without[:, 0], fit.quantile)
        value += step
    window, speed = windows_of(drives, geometry, clock, value), None
    known = np.isfinite(window.moved)
    if _tells(window.distance[known], 0.2 * geometry.half_gauge):
        fit = _regression(window.distance[:, None], window.moved.real, window, known, (0.0,))
        speed = _gain(fit.values[0], fit.without[:, 0], fit.quantile)
    return Gains(speed, turn)


def _collinear(first: Array, second: Array) -> bool:
    """True if values (n,) are nearly proportional to others, as distances to turns on a circle."""
    return float((first @ second) ** 2) > 0.9 * float((first @ first) * (second @ second))


def _tells(values: Array, least: float) -> bool:
    """True if there is more than a little of it."""
    return len(values) > 2 and np.abs(values).sum() > least


def rms(values: np.ndarray) -> float:
    """Root mean square of values (n,), NaN left out; 0 of none."""
    known = values[np.isfinite(values)]
    return float(np.sqrt(np.mean(np.abs(known) ** 2))) if len(known) else 0.0


class _Regression(NamedTuple):
    values: np.ndarray  # (k,) of all windows
    without: np.ndarray  # (G, k) without each block
    quantile: float  # Student's t for an interval of the first one


def _regression(
    columns: Array, values: np.ndarray, window: Window, rows: np.ndarray, prior: Sequence[float]
) -> _Regression:
    """Coefficients (k,) of columns (n, k) for values (n,) in some rows (n,) of windows, by Huber's loss.

    Values may be complex, and so are their coefficients. `prior` (k,) are precisions around 0.
    """
    columns, values = columns[rows], values[rows]
    weight, scale = np.ones(len(values)), 0.0
    for _ in range(20):  # until weights hardly change
        normal = columns.T @ (weight[:, None] * columns) + np.diag(np.multiply(prior, scale**2) + 1e-12)
        fit = np.linalg.solve(normal, columns.T @ (weight * values))
        size = np.abs(values - columns @ fit)
        scale = max(1.4826 * float(np.median(size)), 1e-9)
        weight = np.minimum(1.0, _HUBER * scale / np.maximum(size, 1e-12))
    # without a block, by one step of Newton's method: slopes of the loss, and their changes, not the weights
    bend = np.where(size > _HUBER * scale, 0.5 * weight * np.iscomplexobj(values), 1.0)
    _, number = np.unique(window.block[rows], return_inverse=True)
    hessian = np.zeros((int(number.max()) + 1, len(fit), len(fit)))
    np.add.at(hessian, number, bend[:, None, None] * columns[:, :, None] * columns[:, None, :])
    score = np.zeros(hessian.shape[:2], fit.dtype)
    np.add.at(score, number, (weight * (values - columns @ fit))[:, None] * columns)
    normal = hessian.sum(axis=0) + np.diag(np.multiply(prior, scale**2) + 1e-12)
    without = fit - np.linalg.solve(normal - hessian, score[..., None])[..., 0]
    return _Regression(fit, without, float(student(hessian, normal)[0]))


def _gain(value: float, without: Array, quantile: float) -> Gain:
    """A gain with its interval, from values (G,) without each block of driving and Student's t."""
    half = float(quantile * np.sqrt(cr3(without[:, None] - value)[0, 0]))
    return Gain(float(value), float(value) - half, float(value) + half)
