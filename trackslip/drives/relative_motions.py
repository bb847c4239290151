"""Motions from pose to pose against the path that the wheels drove in between, for poses far apart.

Between such poses the robot turns by any angle, so that no window has a distance and a turn of its
own. Instead the wheels' path is integrated from one pose to the next and compared with the next
pose as seen from the first. The path has its own gain of turns g, from which the separation
multiplier follows, and its own difference between the radii u, because both errors are amplified by
every circle:

    phi(t) = g turn(t) + s u way(t) / b,    P = integral of exp(i phi) d way,

where turn [rad] and way [m] are those of equal wheels without slip and b is the half gauge. A
sensor at the place a of the robot, turned by y, sees the motion

    d = s exp(-i y) P + a (exp(i tau) - 1),    tau = phi at the end,

in units of which s make a metre of the wheels.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np

from trackslip.drives.drive import Drive, Drives
from trackslip.kinematics import Array, RobotGeometry, wrap_angle

_MOST_POINTS: Final = 3000  # most points of the integrated path, to limit time
_MOST_MOTIONS: Final = 300  # most motions that choose the starts
# slip and errors of poses that are expected, relative to the way and the turn [-]
_SCATTER: Final = 0.03
_TIMING: Final = 0.2  # error of the clocks' offset that is expected between poses far apart [s]
_LARGEST_RATIO: Final = 1.5  # largest g / s of robots, and of x and y in cm or mm
_STARTS: Final = 3  # number of gains of turns from which fits start
# least and largest gain of turns of robots: skid steering with a multiplier of 6, and wrong gears
_GAINS: Final = (0.15, 2.4)
_ROUNDS: Final = 15  # number of steps of a fit
# standard deviations of the priors of log s, log g / s, u, y [rad] and a [half gauges]
_PRIOR: Final = np.array([3.0, 0.4, 0.03, 0.7, 2.0, 2.0])
_USUAL_RATIO: Final = -0.3  # usual log g / s: the separation multiplier of tracks is 1 to 2
_USUAL: Final = np.array([0.0, _USUAL_RATIO, 0.0, 0.0, 0.0, 0.0])  # means of the priors
_FEWEST: Final = 4  # least number of motions that tell anything
_CONVERGED: Final = 0.01  # change of the loss below which a fit has converged
_KNOWN: Final = 0.05  # largest standard error of log s with which the unit of lengths is known


class RelativeMotions(NamedTuple):
    """Measured motions between n pairs of poses, and the wheels' angles in between.

    With headings, a motion goes from a pose to the next, in the frame of the first. Without, there
    are two motions from each pose, to the next (first half) and to the one after (second half),
    with the axes of the world.
    """

    angle: Array  # (2, N) angles turned by the left and right wheels at points of the drives [rad]
    first: np.ndarray  # (n,) point at which a motion begins
    last: np.ndarray  # (n,) point at which a motion ends
    moved: np.ndarray  # (n,) motion, complex [m]; NaN if unknown
    turned: Array  # (n,) turn [rad], modulo whole circles; NaN if unknown
    duration: Array  # (n,) time that the motion takes [s]
    framed: bool  # true if the headings are known

    @classmethod
    def of(cls, drives: Sequence[Drive], clock: float) -> RelativeMotions:
        """The motions between successive poses of drives, while encoders were read."""
        joined = Drives.of(drives)
        time = joined.time + clock
        begins = joined.edges[joined.begins]
        ends = joined.edges[np.append(joined.begins[1:], len(joined.edges)) - 1]
        slack = 1e-6
        inside = time >= begins[joined.drive] - slack
        inside &= time <= ends[joined.drive] + slack
        framed = bool(joined.known[1].any())
        known = joined.known[1] if framed else joined.known[0]
        rows = np.flatnonzero(inside & known)

        # points of the path: the poses, and enough of the encoders' intervals
        stride = max(1, len(joined.edges) // _MOST_POINTS)
        points = np.union1d(joined.edges[::stride], time[rows])
        turned = np.cumsum(joined.omega * np.diff(joined.edges)[:, None], axis=0)
        angle = [np.interp(points, joined.edges, np.append(0.0, side)) for side in turned.T]

        place = np.where(joined.known[0], joined.place, np.nan)
        heading = np.where(joined.known[1], joined.heading, np.nan)
        begin = rows[:-1]
        end = rows[1:]
        if not framed:
            begin = np.append(begin, begin)
            end = np.concatenate([end, end[1:], end[-1:]])
        same = (joined.drive[begin] == joined.drive[end]) & (begin != end)
        moved = np.where(same, place[end] - place[begin], np.nan)
        turn = np.where(same, heading[end] - heading[begin], np.nan)
        return cls(
            np.stack(angle),
            np.searchsorted(points, time[begin]),
            np.searchsorted(points, time[end]),
            moved * np.exp(-1j * heading[begin]) if framed else moved,
            turn,
            np.where(same, time[end] - time[begin], np.inf),
            framed,
        )


@dataclass(frozen=True)
class RelativeFit:
    """How well the wheels' path explains relative motions, with the best parameters."""

    loss: float  # negative logarithm of the likelihood
    explained: float  # share of the motions that are explained to within twice their scatter
    speed: float | None  # s, the gain of distances; None if the motions don't determine it
    turn: float  # g, the gain of turns
    turn_ratio: float  # g / s, the inverse of the separation multiplier


def fitted(
    motions: RelativeMotions, geometry: RobotGeometry, factor: float = 1.0
) -> RelativeFit | None:
    """The best fit of the wheels' path to relative motions, from several gains of turns; None if
    there are fewer than four motions or the wheels stand still.

    Gains of turns are those of robots times a `factor`, that of a wrong unit of omega. They are
    limited, as are those of distances, because a robot that hardly moves explains closed squares as
    well as one that drives them.
    """
    model = _Model(motions, geometry, factor)
    if model.count < _FEWEST or not model.driven.any():
        return None
    fits = [model.fit(start) for start in model.starts()]
    return min(fits, key=lambda fit: fit.loss)


class _Path(NamedTuple):
    """Motions by the wheels' path in the frames of their first poses, and their derivatives."""

    place: np.ndarray  # (n,) complex [m]
    by_gain: np.ndarray  # (n,) derivatives by the gain of turns
    by_unequal: np.ndarray  # (n,) derivatives by the difference between the radii


class _Residuals(NamedTuple):
    """Residuals of n motions and of the six priors."""

    value: Array  # (3 n + 6,) in units of the scales: x, y and headings of all motions, priors
    slope: Array  # (3 n + 6, 6) derivatives by the parameters
    scale: Array  # (3 n,) expected errors [m, m, rad]


class _Model:
    """The wheels' path and its fit by the parameters (log s, log g / s, u, y, a)."""

    def __init__(self, motions: RelativeMotions, geometry: RobotGeometry, factor: float) -> None:
        self._gains = factor * _GAINS[0], factor * _GAINS[1]
        left, right = motions.angle * geometry.sprocket_radius
        way = (left + right) / 2
        self._half_gauge = geometry.half_gauge
        self._way = way
        self._turn = (right - left) / (2 * geometry.half_gauge)
        self._bend = way / geometry.half_gauge
        self._first = motions.first
        self._last = motions.last
        self._framed = motions.framed
        self._scatter = _SCATTER + _TIMING / np.maximum(motions.duration, _TIMING)
        self._moved = np.nan_to_num(motions.moved)
        self._turned = np.nan_to_num(motions.turned)
        self._placed = np.isfinite(motions.moved)
        self._headed = np.isfinite(motions.turned)
        self.count = int((self._placed | self._headed).sum())

        # what the belts moved and turned in each motion, forwards and backwards
        belts = (np.abs(np.diff(left)) + np.abs(np.diff(right))) / 2
        self.driven = self._between(np.append(0.0, np.cumsum(belts)))
        self._swept = self._between(np.append(0.0, np.cumsum(np.abs(np.diff(self._turn)))))

    def _between(self, sums: np.ndarray) -> np.ndarray:
        """Differences (n,) of sums (N,) from the beginning to the end of each motion."""
        return np.asarray(sums[self._last] - sums[self._first])

    def starts(self) -> list[Array]:
        """Start values: the gains of turns that explain the headings best, each with the gain of
        distances that explains the lengths of the motions best.
        """
        low, high = self._gains
        some = np.flatnonzero(self._headed)
        some = some[:: max(1, len(some) // _MOST_MOTIONS)]
        if not len(some):
            starts = [self._start(gain) for gain in np.geomspace(low, high, 12).tolist()]
            losses = [self._loss(self._residuals(start)) for start in starts]
            return [starts[k] for k in np.argsort(losses)[:_STARTS]]

        # finer than the distance between two minima, which are a circle apart
        swept = max(float(np.quantile(self._swept[some], 0.9)), 1e-6)
        step = min(0.5 / swept, 0.1 * (high - low))
        grid = np.arange(low, high, step)
        turn = self._between(self._turn)[some]
        missed = wrap_angle(self._turned[some] - grid[:, None] * turn)
        scale = self._heading_scale(grid[:, None])[:, some]
        loss = _negative_log_likelihood(missed, scale).sum(axis=1)
        padded = np.concatenate([[np.inf], loss, [np.inf]])
        lowest = np.flatnonzero((loss <= padded[:-2]) & (loss <= padded[2:]))
        best = lowest[np.argsort(loss[lowest])[:_STARTS]]
        return [self._start(gain) for gain in grid[best].tolist()]

    def _start(self, gain: float) -> Array:
        """Start values (6,) for a gain of turns."""
        values = np.zeros(6)
        values[0] = np.log(gain) - _USUAL_RATIO
        if self._placed.any():
            path = np.abs(self._path(gain, 0.0).place[self._placed])
            moved = np.abs(self._moved[self._placed])
            values[0] = np.log(max(_median_ratio(moved, path), 1e-9))
        values[1] = np.log(gain) - values[0]
        return self._limited(values)

    def _path(self, gain: float, unequal: float) -> _Path:
        """The motions by the wheels' path, with derivatives."""
        heading = gain * self._turn + unequal * self._bend
        middle = (heading[1:] + heading[:-1]) / 2
        chord = np.diff(self._way) * np.sinc(np.diff(heading) / (2 * np.pi))
        ahead = chord * np.exp(1j * middle)
        back = np.exp(-1j * heading[self._first])

        def moved(steps: np.ndarray) -> np.ndarray:
            """Sums (n,) of steps (N - 1,) over each motion, in the frame of its first pose."""
            return self._between(np.append(0.0, np.cumsum(steps))) * back

        def turned(by: Array) -> np.ndarray:
            """Derivatives (n,) of the motions by a factor of `by` (N,) in the heading."""
            at_middle = (by[1:] + by[:-1]) / 2
            return 1j * (moved(ahead * at_middle) - by[self._first] * place)

        place = moved(ahead)
        return _Path(place, turned(self._turn), turned(self._bend))

    def _residuals(self, values: Array) -> _Residuals:
        """The residuals for parameters (6,)."""
        speed = np.exp(values[0])
        gain = np.exp(values[0] + values[1])
        unequal = speed * values[2]
        yaw = values[3]
        arm = values[4] + 1j * values[5]  # [half gauges]
        path = self._path(gain, unequal)
        turn = gain * self._between(self._turn)
        bend = self._between(self._bend)
        around = turn + unequal * bend

        unit = speed * np.exp(-1j * yaw)
        # the unit of x and y, by which turns don't change: log g / s tells it from that of omega
        metre = np.exp(_USUAL_RATIO - values[1])
        circled = np.exp(1j * np.where(self._headed, self._turned, around)) - 1
        lever = metre * self._half_gauge * np.exp(-1j * yaw) * circled
        moved_middle = unit * path.place
        explained = moved_middle + arm * lever
        by_turn = unit * gain * path.by_gain
        by_bend = unit * path.by_unequal
        slopes = [
            moved_middle + by_turn + unequal * by_bend,  # by log s
            by_turn - arm * lever,  # by log g / s
            speed * by_bend,  # by u
            -1j * explained,  # by the sensor's yaw
            lever,  # by the sensor's place ahead
            1j * lever,  # and to the left
        ]
        slope = np.stack(slopes, axis=1)
        moved = self._moved
        if not self._framed:
            ahead = self._frames(explained)
            moved = moved * np.conj(ahead)
            slope = slope - 1j * explained[:, None] * self._turns_of_frames(slope, explained)
        missed = np.where(self._placed, moved - explained, 0.0)
        slope[~self._placed] = 0.0
        place_scale = self._scatter * speed * self.driven + _SCATTER * metre * self._half_gauge

        off = np.where(self._headed, wrap_angle(self._turned - around), 0.0)
        heading_slope = np.zeros((len(off), 6))
        heading_slope[:, 0] = around
        heading_slope[:, 1] = turn
        heading_slope[:, 2] = speed * bend
        heading_slope[~self._headed] = 0.0

        scale = np.concatenate([place_scale, place_scale, self._heading_scale(gain)])
        residual = np.concatenate([missed.real, missed.imag, off]) / scale
        of_motions = np.concatenate([slope.real, slope.imag, heading_slope]) / scale[:, None]
        return _Residuals(
            np.append(residual, -(values - _USUAL) / _PRIOR),
            np.concatenate([of_motions, np.diag(1 / _PRIOR)]),
            scale,
        )

    def _heading_scale(self, gain: Array | float) -> Array:
        """Expected errors (..., n) of the turns, for gains of turns (..., 1) [rad]."""
        by_way = 0.2 * _SCATTER * self.driven / self._half_gauge
        return np.minimum(gain * (self._scatter * self._swept + by_way) + 0.02, np.pi)

    def _frames(self, explained: np.ndarray) -> np.ndarray:
        """Directions (n,) of the frames in which motions (n,) by the wheels fit those measured from
        the same pose best.
        """
        fit = np.where(self._placed, self._moved * np.conj(explained), 0.0)
        first, second = fit.reshape(2, -1)
        both = first + second
        ahead = both / np.maximum(np.abs(both), 1e-12)
        return np.append(ahead, ahead)

    def _turns_of_frames(self, slope: np.ndarray, explained: np.ndarray) -> Array:
        """Derivatives (n, 6) of the frames' angles, from the motions' derivatives (n, 6)."""
        known = np.where(self._placed, explained, 0.0)
        turn = (slope * np.conj(known)[:, None]).imag.reshape(2, -1, 6).sum(axis=0)
        size = (np.abs(known) ** 2).reshape(2, -1).sum(axis=0)
        angle = turn / np.maximum(size, 1e-12)[:, None]
        return np.concatenate([angle, angle])

    def fit(self, start: Array) -> RelativeFit:
        """The fit near start values (6,), by reweighted least squares whose steps are damped until
        the loss falls.
        """
        values = start
        rest = self._residuals(values)
        loss = self._loss(rest)
        damping = 1e-3
        for _ in range(_ROUNDS):
            weight = 1 / (1 + rest.value**2)
            weight[-4:] = 0.5
            normal = rest.slope.T @ (weight[:, None] * rest.slope)
            damped = normal + damping * np.diag(np.diag(normal))
            step = np.linalg.solve(damped, rest.slope.T @ (weight * rest.value))
            moved = self._limited(values + np.clip(step, -1.0, 1.0))
            then = self._residuals(moved)
            lower = self._loss(then)
            if lower >= loss:
                damping *= 10
                continue
            gained = loss - lower
            values = moved
            rest = then
            loss = lower
            damping /= 5
            if gained < _CONVERGED:
                break
        size: Array = np.abs(rest.value[:-6].reshape(3, -1))
        known = self._placed | self._headed
        explained = float(np.mean(np.all(size < 2, axis=0)[known]))
        speed = float(np.exp(values[0])) if self._determines_speed(rest) else None
        return RelativeFit(
            loss=loss,
            explained=explained,
            speed=speed,
            turn=float(np.exp(values[0] + values[1])),
            turn_ratio=float(np.exp(values[1])),
        )

    def _limited(self, values: Array) -> Array:
        """Values (6,) with both gains within their limits."""
        limited = values.copy()
        low, high = np.log(self._gains)
        gain = np.clip(values[0] + values[1], low, high)
        limited[1] = min(values[1], np.log(_LARGEST_RATIO))
        limited[0] = gain - limited[1]
        return limited

    def _determines_speed(self, rest: _Residuals) -> bool:
        """True if the motions determine the gain of distances."""
        if not self._placed.any():
            return False
        size = np.abs(rest.value[:-6].reshape(3, -1)[:2, self._placed])
        # the scatter may be far below what was expected
        scatter = float(np.clip(1.4826 * np.median(size), 0.02, 1.0))
        normal = rest.slope.T @ rest.slope
        return bool(scatter * np.sqrt(np.linalg.inv(normal)[0, 0]) < _KNOWN)

    def _loss(self, rest: _Residuals) -> float:
        """Negative log-likelihood of residuals; without headings, most motions count twice.

        The priors of both gains have long tails, for units of any size.
        """
        known = np.concatenate([self._placed, self._placed, self._headed])
        of_motions = _negative_log_likelihood(rest.value[:-6] * rest.scale, rest.scale)[known]
        each = 1.0 if self._framed else 0.5
        units = np.log1p(rest.value[-6:-4] ** 2)
        return float(each * of_motions.sum() + units.sum() + 0.5 * np.sum(rest.value[-4:] ** 2))


def _median_ratio(values: Array, by: Array) -> float:
    """Median of the ratios of values (n,) to others (n,), weighted by the others."""
    ratio = values / np.maximum(by, 1e-12)
    order = np.argsort(ratio)
    weight = np.cumsum(by[order])
    return float(ratio[order[np.searchsorted(weight, weight[-1] / 2)]])


def _negative_log_likelihood(missed: Array, scale: Array) -> Array:
    """Cauchy's negative log-likelihood of residuals with scales, up to a constant."""
    return np.asarray(np.log(scale) + np.log1p((missed / scale) ** 2))
