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
_HELD: Final = 1e12  # precision of a prior that holds a parameter at 0
_ROUNDING: Final = 1e-9  # rounding error of times [s]
_LONGEST_GAP: Final = 10.0  # longest time between two poses of a window [s]
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

        `clock` is the encoder clock minus the pose clock [s]. A drive with fewer than two positions
        is one with headings only.
        """
        drive = drives.drive
        is_placed, is_headed = drives.known

        # when each drive's wheels were read, by the encoder clock; its first and last interval
        # continue over the margins
        first_edge = drives.begins
        last_edge = np.append(drives.begins[1:], len(drives.edges)) - 1
        edges = drives.edges.copy()
        edges[first_edge] -= margin + _ROUNDING
        edges[last_edge] += margin + _ROUNDING

        # the poses that were measured meanwhile
        time = drives.time + clock
        positions = np.bincount(drive, is_placed, len(drives.drives))
        has_positions = (positions > 1)[drive]
        is_known = np.where(has_positions, is_placed, is_headed)
        is_read = (time >= edges[first_edge][drive]) & (time <= edges[last_edge][drive])
        rows = np.flatnonzero(is_known & is_read)

        # the wheels' motion up to each edge
        speed, yaw_rate = body_twist(drives.omega, 0.0, geometry).T
        duration = np.diff(edges)
        step = speed * duration
        turn = _summed(yaw_rate * duration)
        mean_turn = (turn[1:] + turn[:-1]) / 2

        def at_poses(values: Array) -> Array:
            """Values (K,) at the poses, given those at the edges (M + 1,)."""
            return np.interp(time[rows] + shift, edges, values)

        return cls(
            rows=rows,
            drive=drive[rows],
            time=drives.time[rows],
            place=np.where(has_positions, drives.place, np.nan)[rows],
            heading=drives.headings[rows],
            distance=at_poses(_summed(step)),
            turn=at_poses(turn),
            moment=at_poses(_summed(step * mean_turn)),
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
        if not len(self.time):
            return np.zeros(0, int)

        # the number of each pose's window in its drive
        first_of_drive = np.searchsorted(self.drive, self.drive)
        since_begin = self.time - self.time[first_of_drive]
        number = np.floor((since_begin + _ROUNDING) / length)

        # each first pose of a window, and the last pose of a drive
        in_other_drive = np.diff(self.drive) != 0
        in_other_window = in_other_drive | (np.diff(number) != 0)
        begins_window = np.append(True, in_other_window)
        ends_drive = np.append(in_other_drive, True)
        return np.flatnonzero(begins_window | ends_drive)


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
    intervals = np.array([drive.interval for drive in drives.drives])
    length = np.maximum(WINDOW, 2 * intervals)[steps.drive]
    ends = steps.ends(length)
    if len(ends) < 2:
        none = np.zeros(0)
        return Window(none, none, none + 0j, none, none.astype(int))
    whole = np.diff(steps.drive[ends]) == 0
    begin = ends[:-1][whole]
    end = ends[1:][whole]

    # windows with gaps, or with turns that poses don't tell, are left out
    in_gap = np.diff(steps.time) > _LONGEST_GAP
    ambiguous = np.abs(np.diff(steps.turn)) > np.pi
    good = ~np.logical_or.reduceat(in_gap | ambiguous, ends[:-1])[whole]
    good &= steps.time[end] - steps.time[begin] > 0.49 * length[end]
    block = drives.blocks(WINDOW)[steps.rows[(begin + end) // 2]]
    distance = steps.distance[end] - steps.distance[begin]
    turn = steps.turn[end] - steps.turn[begin]
    chord = steps.place[end] - steps.place[begin]
    good &= ~(np.abs(chord) > _longest(chord, distance, geometry.half_gauge * turn))

    if drives.known[1].any():
        turned = steps.heading[end] - steps.heading[begin]
        moved = np.add.reduceat(steps.moved, ends[:-1])[whole]
    else:
        # the directions of successive chords, while the robot moves
        moving = good & (np.abs(chord) > 0.3 * rms_of_known(chord[good]))
        moving &= np.abs(distance) > 0.3 * rms_of_known(distance)
        # a robot that reverses moves against its heading
        along = np.where(distance < 0, -chord, chord)
        turned = np.append(np.angle(along[1:] * np.conj(along[:-1])), np.nan)
        next_moving = np.append(moving[1:] & (begin[1:] == end[:-1]), False)
        turned[~(moving & next_moving)] = np.nan
        direction = (steps.moment[end] - steps.moment[begin]) / np.where(moving, distance, 1.0)
        shortened = np.sinc(turn_gain * turn / (2 * np.pi))  # chords of arcs
        distance = np.abs(distance * shortened)
        moved = np.abs(chord) + 0j
        turn = np.append(np.diff(direction), 0.0)
        # chords are ambiguous for turns by half a circle or more
        turned[np.abs(turn) > 2.0] = np.nan
    return Window(
        distance, turn, np.where(good, moved, np.nan), np.where(good, turned, np.nan), block
    )


def _summed(increments: Array) -> Array:
    """Sums (M + 1,) of increments (M,), from 0."""
    return np.append(0.0, np.cumsum(increments))


def _longest(chord: np.ndarray, distance: Array, aside: Array) -> float:
    """Largest plausible length of chords (n,) [m], given the wheels' `distance` (n,) and motion
    `aside` (n,) [m].
    """
    moving = np.isfinite(chord) & (np.abs(distance) > 0.3 * rms_of_known(distance))
    usual = np.median(np.abs(chord[moving] / distance[moving])) if moving.any() else 0.0
    return float(3 * usual * (np.abs(distance) + np.abs(aside)).max(initial=0.0)) or np.inf


def gains_of(drives: Drives, geometry: RobotGeometry, clock: float) -> Gains:
    """Compute gains from the drives with headings, or from all drives if none has headings."""
    headed = [drive for drive in drives.drives if drive.has_heading]
    if 0 < len(headed) < len(drives.drives):
        drives = Drives.of(headed)
    window = windows_of(drives, geometry, clock)

    # what an error of the clocks changes, per second
    before = windows_of(drives, geometry, clock, -GRID)
    after = windows_of(drives, geometry, clock, GRID)
    late_distance = (after.distance - before.distance) / (2 * GRID)
    late_turn = (after.turn - before.turn) / (2 * GRID)

    turn = None
    known = np.isfinite(window.turned) & np.isfinite(late_turn)
    if _tells(window.turn[known], 0.1) and window.turned[known].any():
        columns = np.column_stack([window.turn, late_turn])
        fit = _regression(columns, window.turned, window, known, (0.0, GRID**-2))
        turn = _gain(fit.values[0], fit.without[:, 0], fit.quantile)

    if not headed:
        window = windows_of(drives, geometry, clock, turn_gain=turn.value if turn else 1.0)
    known = np.isfinite(window.moved)
    if headed:
        known &= np.isfinite(window.turned)
    if not _tells(window.distance[known], 0.2 * geometry.half_gauge):
        return Gains(None, turn)
    across = window.turned if headed else np.zeros(len(known))
    columns = np.column_stack([window.distance, across, late_distance])
    moved = window.moved if headed else window.moved.real
    prior = (0.0, _precision_aside(window, known, geometry, bool(headed)), GRID**-2)
    fit = _regression(columns, moved, window, known, prior)
    along, aside, _ = fit.values
    ahead = along / abs(along) * (-1.0 if along.real < 0 else 1.0)
    speed = _gain((along / ahead).real, (fit.without[:, 0] / ahead).real, fit.quantile)
    return Gains(speed, turn, float(-np.angle(ahead)), complex(aside / 1j / ahead))


def _precision_aside(
    window: Window, known: np.ndarray, geometry: RobotGeometry, headed: bool
) -> float:
    """Precision of the prior for the sensor's place, in units of x and y.

    Nearly on a circle, a sideways offset looks like a gain, so that it is held, as it is without
    headings.
    """
    distance = window.distance[known]
    turned = window.turned[known]
    if not headed:
        return _HELD
    on_circle = (distance @ turned) ** 2 > 0.9 * (distance @ distance) * (turned @ turned)
    if on_circle:
        return _HELD
    unit = max(
        rms_of_known(window.moved[known]) / rms_of_known(distance), 1.0
    )  # of x and y, such as mm
    return float((2 * geometry.half_gauge * unit) ** -2)


def _tells(values: Array, least: float) -> bool:
    """True if there are more than two values (n,) and their absolute values sum to more than
    `least`.
    """
    return len(values) > 2 and np.abs(values).sum() > least


def rms_of_known(values: np.ndarray) -> float:
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
    columns = columns[rows]
    values = values[rows]

    # reweighted least squares
    weight = np.ones(len(values))
    scale = 0.0
    for _ in range(20):  # enough for the weights to converge
        weighted = weight[:, None] * columns
        precision = np.diag(np.multiply(prior, scale**2) + 1e-12)
        fit = np.linalg.solve(columns.T @ weighted + precision, columns.T @ (weight * values))
        size = np.abs(values - columns @ fit)
        scale = max(1.4826 * float(np.median(size)), 1e-9)
        weight = np.minimum(1.0, _HUBER * scale / np.maximum(size, 1e-12))

    # fits without a block take one Newton step with derivatives of the loss instead of the weights
    outlying = size > _HUBER * scale
    bend = np.where(outlying, 0.5 * weight * np.iscomplexobj(values), 1.0)
    _, number = np.unique(window.block[rows], return_inverse=True)
    blocks = int(number.max()) + 1
    curvature = bend[:, None, None] * columns[:, :, None] * columns[:, None, :]
    hessian = np.zeros((blocks, len(fit), len(fit)))
    np.add.at(hessian, number, curvature)
    gradient = (weight * (values - columns @ fit))[:, None] * columns
    score = np.zeros((blocks, len(fit)), fit.dtype)
    np.add.at(score, number, gradient)
    normal = hessian.sum(axis=0) + np.diag(np.multiply(prior, scale**2) + 1e-12)
    without = fit - newton_steps(normal - hessian, score)
    return _Regression(fit, without, float(student(hessian, normal)[0]))


def _gain(value: float, without: Array, quantile: float) -> Gain:
    """A gain with its interval, from the values (G,) without each block of driving and Student's
    t.
    """
    half = float(quantile * np.sqrt(cr3(without[:, None] - value)[0, 0]))
    return Gain(float(value), float(value) - half, float(value) + half)
