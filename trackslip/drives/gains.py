"""Gains: how far a robot moves and turns per metre and radian of its wheels, by robust regression
over windows.

By hand, a gain is the measured distance (or turn) divided by that of the wheels. Without headings,
a turn is the angle between successive chords of the path.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np

from trackslip.drives.clocks import GRID
from trackslip.drives.drive import Drives
from trackslip.intervals import Gain, cr3, newton_steps, student
from trackslip.kinematics import Array, RobotGeometry, body_twist

WINDOW: Final = 2.0
"""Duration of windows [s]: noise of 2 cm is then 5 % of a slow robot's distance, and arcs are below
half a circle.
"""
# [standard deviations]: 95 % efficient for normal errors (P. J. Huber, *Robust Statistics*)
_HUBER: Final = 1.345


@dataclass(frozen=True)
class Gains:
    """The gains of distances and of turns, and the sensor's place."""

    speed: Gain | None  # gain of distances; None if the driving doesn't determine it
    turn: Gain | None  # gain of turns; None if the driving doesn't determine it
    heading: float = 0.0  # heading of the sensor in the robot [rad]; 0 without headings
    arm: complex = 0j  # place of the sensor in the robot, x + i y [m]; 0 without headings

    @property
    def factors(self) -> tuple[float, float]:
        """Values of the gains of distances and of turns; 1 if the driving doesn't determine a
        gain.
        """
        return self.speed.value if self.speed else 1.0, self.turn.value if self.turn else 1.0

    def law(self, geometry: RobotGeometry) -> dict[str, float]:
        """The gains as constant ICRs: 1 + ε is the gain of speed, (1 + ε) b / (b + D) that of yaw
        rate.
        """
        speed = self.factors[0]
        turn = self.turn.value if self.turn else speed
        if min(speed, turn) <= 0:  # the poses hardly match the wheels
            speed = turn = 1.0
        return {"offset": geometry.half_gauge * (speed / turn - 1), "radius_error": speed - 1}

    def start(self, geometry: RobotGeometry, clock: float) -> dict[str, float]:
        """Start values for fits, by name, including a clock offset [s]; law parameters only if
        `speed` is known.
        """
        place = {"sensor_x": self.arm.real, "sensor_y": self.arm.imag, "sensor_yaw": self.heading}
        return (self.law(geometry) if self.speed else {}) | place | {"clock_offset": clock}


class Window(NamedTuple):
    """Motion of drives in n windows."""

    distance: Array  # (n,) distance of the wheels [m]
    # (n,) turn of the wheels [rad]; without headings, between mean directions of this window and
    # the next
    turn: Array
    # (n,) measured motion in the sensor frame, complex [m]; without headings, the chord's length
    moved: np.ndarray
    # (n,) measured turn [rad]; without headings, from this chord to the next; NaN where unknown
    turned: Array
    block: np.ndarray  # (n,) index of the block of driving


@dataclass(frozen=True)
class Steps:
    """The poses between the first and last encoder readings of drives, and the wheels' motion up to
    each pose.
    """

    rows: np.ndarray  # (K,) indices of the poses
    drive: np.ndarray  # (K,) index of the drive
    time: Array  # (K,) times of the poses [s]
    place: np.ndarray  # (K,) positions, complex [m]; NaN where unknown
    heading: Array  # (K,) headings, interpolated at positions [rad]; NaN in drives without headings
    distance: Array  # (K,) distance driven by the wheels [m]
    turn: Array  # (K,) turn of the wheels [rad]
    moment: Array  # (K,) integral of the wheels' turn over the distance [rad m]

    @classmethod
    def of(
        cls,
        drives: Drives,
        geometry: RobotGeometry,
        clock: float,
        shift: float = 0.0,
        margin: float = 0.0,
    ) -> Steps:
        """Steps of drives, with wheels read `shift` [s] later than by `clock`, and `margin` [s]
        added at both ends.
        """
        of, at = drives.drive, drives.time + clock
        placed = (np.bincount(of, drives.known[0], len(drives.drives)) > 1)[of]
        edges, ends = drives.edges.copy(), np.append(drives.begins[1:], len(drives.edges)) - 1
        edges[drives.begins] -= margin + 1e-9
        edges[ends] += margin + 1e-9
        rows = np.where(placed, drives.known[0], drives.known[1])
        rows = np.flatnonzero(rows & (at >= edges[drives.begins][of]) & (at <= edges[ends][of]))
        way, turn = np.diff(edges) * body_twist(drives.omega, 0.0, geometry).T
        turned = np.append(0.0, np.cumsum(turn))
        moment = np.append(0.0, np.cumsum(way * (turned[1:] + turned[:-1]) / 2))
        sums = (np.append(0.0, np.cumsum(way)), turned, moment)
        return cls(
            rows,
            of[rows],
            drives.time[rows],
            np.where(placed, drives.place, np.nan)[rows],
            drives.headings[rows],
            *(np.interp(at[rows] + shift, edges, values) for values in sums),
        )

    @property
    def moved(self) -> np.ndarray:
        """Measured motions (K - 1,) along arcs, relative to the headings, complex [m]; NaN where
        unknown.
        """
        turn = np.diff(self.heading)
        chord = np.diff(self.place) * np.exp(-0.5j * (self.heading[1:] + self.heading[:-1]))
        return chord / np.maximum(np.sinc(turn / (2 * np.pi)), 0.1)

    def ends(self, length: Array) -> np.ndarray:
        """Poses (n + 1,) that bound windows of about `length` (K,) [s]; windows end with their
        drive.
        """
        begin = self.time[np.searchsorted(self.drive, self.drive)]
        number = np.floor((self.time - begin + 1e-9) / length)
        other = np.diff(self.drive) != 0
        bound = np.append(True, other | (np.diff(number) != 0)) | np.append(other, True)
        return np.flatnonzero(bound[: len(self.time)])


def windows_of(
    drives: Drives,
    geometry: RobotGeometry,
    clock: float,
    shift: float = 0.0,
    turn_gain: float = 1.0,
) -> Window:
    """Motion of drives in windows, with wheels read `shift` [s] later than by the clock offset
    `clock` [s].

    If no drive has headings, distances are chord lengths of arcs that turn by `turn_gain` times the
    wheels' turn.
    """
    steps = Steps.of(drives, geometry, clock, shift)
    length = np.maximum(WINDOW, 2 * np.array([drive.interval for drive in drives.drives]))[
        steps.drive
    ]
    ends = steps.ends(length)
    if len(ends) < 2:
        none = np.zeros(0)
        return Window(none, none, none + 0j, none, none.astype(int))
    whole = np.diff(steps.drive[ends]) == 0
    begin, end = ends[:-1][whole], ends[1:][whole]
    lost = (np.diff(steps.time) > 10.0) | (np.abs(np.diff(steps.turn)) > np.pi)
    good = ~np.logical_or.reduceat(lost, ends[:-1])[whole]
    good &= steps.time[end] - steps.time[begin] > 0.49 * length[end]
    block = drives.blocks(WINDOW)[steps.rows[(begin + end) // 2]]
    distance, turn = (
        steps.distance[end] - steps.distance[begin],
        steps.turn[end] - steps.turn[begin],
    )
    chord = steps.place[end] - steps.place[begin]
    good &= ~(np.abs(chord) > _longest(chord, distance, geometry.half_gauge * turn))
    if drives.known[1].any():
        turned = steps.heading[end] - steps.heading[begin]
        moved = np.add.reduceat(steps.moved, ends[:-1])[whole]
    else:
        moving = (
            good
            & (np.abs(chord) > 0.3 * rms(chord[good]))
            & (np.abs(distance) > 0.3 * rms(distance))
        )
        # a robot that reverses moves against its heading
        along = np.where(distance < 0, -chord, chord)
        turned = np.append(np.angle(along[1:] * np.conj(along[:-1])), np.nan)
        turned[~(moving & np.append(moving[1:] & (begin[1:] == end[:-1]), False))] = np.nan
        direction = (steps.moment[end] - steps.moment[begin]) / np.where(moving, distance, 1.0)
        distance, moved = (
            np.abs(distance * np.sinc(turn_gain * turn / (2 * np.pi))),
            np.abs(chord) + 0j,
        )
        turn = np.append(np.diff(direction), 0.0)
        # chords are ambiguous for turns by half a circle or more
        turned[np.abs(turn) > 2.0] = np.nan
    return Window(
        distance, turn, np.where(good, moved, np.nan), np.where(good, turned, np.nan), block
    )


def _longest(chord: np.ndarray, distance: Array, aside: Array) -> float:
    """Largest plausible length of chords (n,) [m], given the wheels' `distance` (n,) and motion
    `aside` (n,) [m].
    """
    moving = np.isfinite(chord) & (np.abs(distance) > 0.3 * rms(distance))
    usual = np.median(np.abs(chord[moving] / distance[moving])) if moving.any() else 0.0
    return float(3 * usual * (np.abs(distance) + np.abs(aside)).max(initial=0.0)) or np.inf


def gains_of(drives: Drives, geometry: RobotGeometry, clock: float) -> Gains:
    """Compute gains from the drives with headings, or from all drives if none has headings."""
    headed = [drive for drive in drives.drives if drive.has_heading]
    if 0 < len(headed) < len(drives.drives):
        drives = Drives.of(headed)
    before, window, after = (
        windows_of(drives, geometry, clock, shift) for shift in (-GRID, 0.0, GRID)
    )
    late = np.column_stack([after.distance - before.distance, after.turn - before.turn]) / (
        2 * GRID
    )
    turn = speed = None
    heading, arm = 0.0, 0j
    known = np.isfinite(window.turned) & np.isfinite(late[:, 1])
    if _tells(window.turn[known], 0.1) and window.turned[known].any():
        fit = _regression(
            np.column_stack([window.turn, late[:, 1]]),
            window.turned,
            window,
            known,
            (0.0, GRID**-2),
        )
        turn = _gain(fit.values[0], fit.without[:, 0], fit.quantile)
    if not headed:
        window = windows_of(drives, geometry, clock, turn_gain=turn.value if turn else 1.0)
    known = np.isfinite(window.moved) & (np.isfinite(window.turned) if headed else True)
    if _tells(window.distance[known], 0.2 * geometry.half_gauge):
        way, turned = window.distance[known], window.turned[known]
        unit = max(rms(window.moved[known]) / rms(way), 1.0)  # unit of x and y, such as mm
        aside = (2 * geometry.half_gauge * unit) ** -2  # prior precision of the sensor's place
        if not headed or (way @ turned) ** 2 > 0.9 * (way @ way) * (turned @ turned):
            aside = 1e12  # nearly on a circle, a sideways offset looks like a gain
        across = window.turned if headed else np.zeros(len(known))
        columns = np.column_stack([window.distance, across, late[:, 0]])
        moved = window.moved if headed else window.moved.real
        fit = _regression(columns, moved, window, known, (0.0, aside, GRID**-2))
        along, across, _ = fit.values
        ahead = along / abs(along) * (-1.0 if along.real < 0 else 1.0)
        speed = _gain((along / ahead).real, (fit.without[:, 0] / ahead).real, fit.quantile)
        heading, arm = float(-np.angle(ahead)), complex(across / 1j / ahead)
    return Gains(speed, turn, heading, arm)


def _tells(values: Array, least: float) -> bool:
    """True if there are more than two values (n,) and their absolute values sum to more than
    `least`.
    """
    return len(values) > 2 and np.abs(values).sum() > least


def rms(values: np.ndarray) -> float:
    """Root mean square of values (n,), ignoring NaN; 0 without values."""
    known = values[np.isfinite(values)]
    return float(np.sqrt(np.mean(np.abs(known) ** 2))) if len(known) else 0.0


class _Regression(NamedTuple):
    values: np.ndarray  # (k,) coefficients from all windows
    without: np.ndarray  # (G, k) coefficients without each block
    quantile: float  # Student's t for an interval of the first coefficient


def _regression(
    columns: Array, values: np.ndarray, window: Window, rows: np.ndarray, prior: Sequence[float]
) -> _Regression:
    """Regress values (n,) on columns (n, k) with Huber's loss, over the windows selected by `rows`
    (n,).

    Complex values have complex coefficients. `prior` (k,) has the precisions of the coefficients'
    priors around 0.
    """
    columns, values = columns[rows], values[rows]
    weight, scale = np.ones(len(values)), 0.0
    for _ in range(20):  # enough for the weights to converge
        normal = columns.T @ (weight[:, None] * columns) + np.diag(
            np.multiply(prior, scale**2) + 1e-12
        )
        fit = np.linalg.solve(normal, columns.T @ (weight * values))
        size = np.abs(values - columns @ fit)
        scale = max(1.4826 * float(np.median(size)), 1e-9)
        weight = np.minimum(1.0, _HUBER * scale / np.maximum(size, 1e-12))
    # fits without a block take one Newton step with derivatives of the loss instead of the weights
    bend = np.where(size > _HUBER * scale, 0.5 * weight * np.iscomplexobj(values), 1.0)
    _, number = np.unique(window.block[rows], return_inverse=True)
    hessian = np.zeros((int(number.max()) + 1, len(fit), len(fit)))
    np.add.at(hessian, number, bend[:, None, None] * columns[:, :, None] * columns[:, None, :])
    score = np.zeros(hessian.shape[:2], fit.dtype)
    np.add.at(score, number, (weight * (values - columns @ fit))[:, None] * columns)
    normal = hessian.sum(axis=0) + np.diag(np.multiply(prior, scale**2) + 1e-12)
    without = fit - newton_steps(normal - hessian, score)
    return _Regression(fit, without, float(student(hessian, normal)[0]))


def _gain(value: float, without: Array, quantile: float) -> Gain:
    """A gain with its interval, from the values (G,) without each block of driving and Student's
    t.
    """
    half = float(quantile * np.sqrt(cr3(without[:, None] - value)[0, 0]))
    return Gain(float(value), float(value) - half, float(value) + half)
