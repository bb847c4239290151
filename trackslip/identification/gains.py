"""Gains: how far a robot moves and turns per metre and radian of its wheels, by robust regression over windows.

This is what people compute by hand: the distance measured over that of the wheels, the turn measured over that of the
wheels. Without headings, the turn is that between successive chords of the path.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from trackslip.identification.fitted import FEWEST_BLOCKS, Gain, student
from trackslip.identification.preparation import PreparedDrive, reckoned
from trackslip.identification.windows import BLOCK
from trackslip.kinematics import Array, RobotGeometry, wrap_angle

WINDOW = 2.0
"""Duration of windows [s]: noise of 2 cm is 5 % of the distance of a slow robot then, and steady arcs stay below half a
turn."""
LONGEST = 10.0
"""Time between poses above which windows don't tell how often a robot turned [s]."""
_OFF = 0.1  # error of the clock that is allowed for [s]: the step of its grid
_HUBER = 1.345  # standard deviations: 95 % efficient for normal errors (P. J. Huber, *Robust Statistics*)
_ROUNDS = 20
_ALONG = 0.9  # squared correlation of distances and turns above which one can't be told from the other
_TURNS = np.concatenate([-np.geomspace(0.05, 3.0, 25), np.geomspace(0.05, 3.0, 25)])  # gains tried to start from


@dataclass(frozen=True)
class Gains:
    """Of distances and turns; None where the driving doesn't tell."""

    speed: Gain | None
    turn: Gain | None
    heading: float = 0.0
    """Direction of forward motion in the frame of the headings [rad]; 0 without headings."""
    arm: complex = 0j
    """Place of the sensor in the robot, x + i y [m]; 0 without headings."""

    def law(self, geometry: RobotGeometry) -> dict[str, float]:
        """The gains as constant ICRs: (1 + ε) on the speed, (1 + ε) b / (b + D) on the yaw rate; 1 where not known."""
        speed = self.speed.value if self.speed else 1.0
        turn = self.turn.value if self.turn else speed
        return {"offset": geometry.half_gauge * (speed / turn - 1), "radius_error": speed - 1}

    def start(self, geometry: RobotGeometry, clock: float) -> dict[str, float]:
        """Values to start fits from, by name, with a clock offset [s]; of the law only if distances are known."""
        place = {"sensor_x": self.arm.real, "sensor_y": self.arm.imag, "sensor_yaw": self.heading}
        return (self.law(geometry) if self.speed else {}) | place | {"clock_offset": clock}


@dataclass(frozen=True)
class Window:
    """Motion in windows of drives, n in all."""

    distance: Array  # (n,) by the wheels [m]
    turn: Array  # (n,) by the wheels [rad]
    moved: np.ndarray  # (n,) measured in the frame of the sensor, complex; without headings, the chord's size [m]
    turned: Array  # (n,) measured [rad]; without headings, from this chord to the next one; NaN where not known
    block: np.ndarray  # (n,) index of the block of driving
    duration: Array  # (n,) [s]

    @classmethod
    def joined(cls, parts: Sequence[Window]) -> Window:
        """The windows of several drives; blocks are numbered on."""
        blocks, first = list[np.ndarray](), 0
        for part in parts:
            blocks.append(part.block + first)
            first += int(part.block.max(initial=-1)) + 1
        return cls(
            np.concatenate([part.distance for part in parts]),
            np.concatenate([part.turn for part in parts]),
            np.concatenate([part.moved for part in parts]),
            np.concatenate([part.turned for part in parts]),
            np.concatenate(blocks),
            np.concatenate([part.duration for part in parts]),
        )


@dataclass(frozen=True)
class Steps:
    """From pose to pose of a drive: measured, and by its wheels."""

    time: Array  # (K,) of the poses, pose clock [s]
    place: np.ndarray | None  # (K,) complex [m]
    heading: Array | None  # (K,) [rad]
    distance: Array  # (K - 1,) by the wheels [m]
    turn: Array  # (K - 1,) by the wheels [rad]
    rows: np.ndarray  # (K,) indices of the poses in the drive

    @classmethod
    def of(
        cls, drive: PreparedDrive, geometry: RobotGeometry, clock: float, shift: float = 0.0, margin: float = 0.0
    ) -> Steps:
        """The steps between poses that encoders cover, by wheels `shift` [s] later.

        Wheels go on at their first and last speeds for `margin` [s]. Headings are interpolated to positions where both
        exist.
        """
        time, pose = drive.time, drive.pose
        placed, headed = np.isfinite(pose[:, 0]), np.isfinite(pose[:, 2])
        rows = placed if placed.sum() > 1 else headed
        at = time + clock
        edges = drive.edges.copy()
        edges[[0, -1]] += -margin - 1e-9, margin + 1e-9
        rows = rows & (at >= edges[0]) & (at <= edges[-1])
        at = at + shift
        place = pose[rows, 0] + 1j * pose[rows, 1] if placed.sum() > 1 else None
        heading = np.interp(time[rows], time[headed], pose[headed, 2]) if headed.sum() > 1 else None
        half, radius = geometry.half_gauge, geometry.sprocket_radius
        angle = np.concatenate([np.zeros((1, 2)), np.cumsum(drive.omega * np.diff(edges)[:, None], axis=0)])
        left, right = (radius * np.diff(np.interp(at[rows], edges, a)) for a in angle.T)
        return cls(time[rows], place, heading, (left + right) / 2, (right - left) / (2 * half), np.flatnonzero(rows))

    @property
    def moved(self) -> np.ndarray:
        """(K - 1,) Measured motion along the arc, in the frame of the headings, complex [m]."""
        assert self.place is not None
        assert self.heading is not None
        turn = np.diff(self.heading)
        chord = np.diff(self.place) * np.exp(-0.5j * (self.heading[1:] + self.heading[:-1]))
        return chord / np.maximum(np.sinc(turn / (2 * np.pi)), 0.1)

    def ends(self, length: float) -> np.ndarray:
        """Poses (n + 1,) that bound windows of about this duration [s]."""
        if len(self.time) < 2:
            return np.zeros(0, int)
        cuts = np.arange(self.time[0], self.time[-1] + length / 2, length)
        return np.unique(np.searchsorted(self.time, cuts - 1e-9).clip(max=len(self.time) - 1))


def windows_of(
    drive: PreparedDrive, geometry: RobotGeometry, clock: float, turn_gain: float = 1.0, shift: float = 0.0
) -> Window:
    """Motion of a drive in windows, by wheels with this gain of turns, `shift` [s] later than by this clock.

    Without headings, distances and turns are those of chords.
    """
    steps = Steps.of(drive, geometry, clock, shift)
    length = max(WINDOW, 2 * drive.interval)
    ends = steps.ends(length)
    if len(ends) < 2:
        none = np.zeros(0)
        return Window(none, none, none + 0j, none, none.astype(int), none)
    duration = np.diff(steps.time)
    lost = (duration > LONGEST) | (np.abs(steps.turn) > np.pi)
    sums = {name: np.add.reduceat(values, ends[:-1]) for name, values in (("d", steps.distance), ("w", steps.turn))}
    good = (np.add.reduceat(lost, ends[:-1]) == 0) & (np.diff(steps.time[ends]) > 0.49 * length)
    middle = (steps.time[ends[1:]] + steps.time[ends[:-1]]) / 2 - steps.time[0]
    parts = max(1, round((steps.time[-1] - steps.time[0]) / BLOCK))
    block = np.minimum((middle * parts / (steps.time[-1] - steps.time[0])).astype(int), parts - 1)
    distance, turn = sums["d"], turn_gain * sums["w"]
    if steps.heading is not None:
        turned = np.diff(steps.heading[ends])
        moved = np.full(len(turned), np.nan + 0j) if steps.place is None else np.add.reduceat(steps.moved, ends[:-1])
    else:
        assert steps.place is not None
        chord = np.diff(steps.place[ends])
        by_wheels = np.diff(reckoned(drive, geometry, turn_gain, steps.time[ends] + clock)[0])
        distance, moved = np.abs(by_wheels), np.abs(chord) + 0j
        turned = np.append(np.angle(chord[1:] * np.conj(chord[:-1])), np.nan)
        turn = np.append(np.angle(by_wheels[1:] * np.conj(by_wheels[:-1])), np.nan)
        moving = (np.abs(chord) > 0.3 * _rms(chord)) & (distance > 0.3 * _rms(distance)) & good
        turned[~(moving & np.append(moving[1:], False))] = np.nan
    return Window(
        distance, turn, np.where(good, moved, np.nan), np.where(good, turned, np.nan), block, np.diff(steps.time[ends])
    )


def gains_of(drives: Sequence[PreparedDrive], geometry: RobotGeometry, clock: float) -> Gains:
    """Gains of drives with poses all of one kind."""
    if not any(drive.has_heading for drive in drives):
        return _of_positions(drives, geometry, clock)
    headed = [drive for drive in drives if drive.has_heading]
    before, window, after = (
        Window.joined([windows_of(drive, geometry, clock, shift=shift) for drive in headed])
        for shift in (-_OFF, 0.0, _OFF)
    )
    late = np.column_stack([after.distance - before.distance, after.turn - before.turn]) / (2 * _OFF)
    turn = speed = None
    heading, arm = 0.0, 0j
    known = np.isfinite(window.turned)
    if _tells(window.turn[known], 0.1):
        columns = np.column_stack([window.turn, late[:, 1]])[known]
        fit = _regression(columns, window.turned[known], window.block[known], np.array([0.0, _OFF**-2]))
        turn = _gain(fit[0][0], fit[1][:, 0], fit[2])
    known = np.isfinite(window.moved) & np.isfinite(window.turned)
    if _tells(window.distance[known], 0.2 * geometry.half_gauge):
        prior = np.array([0.0, (2 * geometry.half_gauge) ** -2, _OFF**-2])  # of the sensor's place
        if _collinear(window.distance[known], window.turned[known]):
            prior[1] = 1e12  # an offset to the side looks like a gain
        columns = np.column_stack([window.distance, window.turned, late[:, 0]])[known]
        (along, aside, _), without, quantile = _regression(columns, window.moved[known], window.block[known], prior)
        ahead = along / abs(along)
        sign = -1.0 if ahead.real < 0 else 1.0
        speed = _gain(sign * abs(along), sign * (without[:, 0] / ahead).real, quantile)
        heading, arm = float(-np.angle(sign * ahead)), complex(aside / 1j / (sign * ahead))
    return Gains(speed, turn, heading, arm)


def _of_positions(drives: Sequence[PreparedDrive], geometry: RobotGeometry, clock: float) -> Gains:
    """Gains of drives whose poses have no headings."""

    def windows(turn_gain: float) -> Window:
        return Window.joined([windows_of(drive, geometry, clock, turn_gain) for drive in drives])

    def missed(turn_gain: float) -> tuple[Array, Window]:
        window = windows(turn_gain)
        return np.nan_to_num(wrap_angle(window.turned - window.turn)), window

    sizes = [float(np.minimum(np.abs(missed(gain)[0]), 1.0).sum()) for gain in _TURNS]
    value = float(_TURNS[int(np.argmin(sizes))])
    turn: Gain | None = None
    if np.ptp(sizes) > 1e-9:
        for _ in range(6):
            change = 1e-3
            off, window = missed(value)
            slope = -wrap_angle(missed(value + change)[0] - off) / change
            used = (np.abs(slope) > 0) & np.isfinite(window.turned)
            if not used.any():
                break
            fit = _regression(slope[used, None], off[used], window.block[used], np.zeros(1))
            step = float(np.clip(fit[0][0], -0.3, 0.3))
            turn = _gain(value + step, value + fit[1][:, 0], fit[2])
            value += step
    window, speed = windows(value), None
    known = np.isfinite(window.moved)
    if _tells(window.distance[known], 0.2 * geometry.half_gauge):
        fit = _regression(window.distance[known, None], window.moved[known].real, window.block[known], np.zeros(1))
        speed = _gain(fit[0][0], fit[1][:, 0], fit[2])
    return Gains(speed, turn)


def _collinear(first: Array, second: Array) -> bool:
    """True if values (n,) are nearly proportional to others, as distances to turns on a circle."""
    return float((first @ second) ** 2) > _ALONG * float((first @ first) * (second @ second))


def _tells(values: Array, least: float) -> bool:
    """True if there is more than a little of it."""
    return len(values) > 2 and _rms(values) > 0 and np.abs(values).sum() > least


def _rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(np.abs(values) ** 2))) if len(values) else 0.0


def _regression(
    columns: Array, values: np.ndarray, block: np.ndarray, prior: Array
) -> tuple[np.ndarray, np.ndarray, float]:
    """Coefficients (k,) of columns (n, k) for values (n,) by Huber's loss, and those without each block (G, k).

    Last comes Student's t for an interval of the first. Values may be complex, and so are their coefficients. `prior`
    (k,) are precisions around 0.
    """
    weight = np.ones(len(values))
    scale, fit = 1.0, np.zeros(columns.shape[1], values.dtype)
    for turn in range(_ROUNDS):
        normal = columns.T @ (weight[:, None] * columns) + np.diag(prior * scale**2 * (turn > 0) + 1e-12)
        fit = np.linalg.solve(normal, columns.T @ (weight * values))
        size = np.abs(values - columns @ fit)
        scale = max(1.4826 * float(np.median(size)), 1e-9)
        weight = np.minimum(1.0, _HUBER * scale / np.maximum(size, 1e-12))
    # without a block, by one step of Newton's method: slopes of the loss, and their changes, not the weights
    outside = size > _HUBER * scale
    bend = np.where(outside, 0.5 * weight * np.iscomplexobj(values), 1.0)
    _, number = np.unique(block, return_inverse=True)
    count = int(number.max()) + 1
    hessian = np.zeros((count, columns.shape[1], columns.shape[1]))
    np.add.at(hessian, number, bend[:, None, None] * columns[:, :, None] * columns[:, None, :])
    score = np.zeros((count, columns.shape[1]), fit.dtype)
    np.add.at(score, number, (weight * (values - columns @ fit))[:, None] * columns)
    normal = hessian.sum(axis=0) + np.diag(prior * scale**2 + 1e-12)
    without = fit - np.linalg.solve(normal - hessian, score[..., None])[..., 0]
    return fit, without, float(student(hessian, normal)[0])


def _gain(value: float, without: Array, quantile: float) -> Gain:
    """A gain with its interval, from values (G,) without each block of driving and Student's t."""
    count = len(without)
    if count < FEWEST_BLOCKS:
        return Gain(float(value), np.nan, np.nan)
    error = np.sqrt((count - 1) / count * np.sum((without - value) ** 2))
    half = float(quantile * error)
    return Gain(float(value), float(value) - half, float(value) + half)
