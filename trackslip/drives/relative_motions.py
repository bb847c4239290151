"""Motions from pose to pose against the path that the wheels drove in between, for poses far apart.

Between such poses the robot turns by any angle, so that no window has a distance and a turn of its
own. Instead the wheels' path is integrated from one pose to the next and compared with the next
pose as seen from the first. Points in the plane are complex numbers, x + i y.

**Path.** By the robot's geometry, without slip, the middle of the wheels drives the distance l [m]
and turns by theta [rad]. On the ground, it drives s l and turns by

    phi = g theta + s u l / b

with the gain of distances s, the gain of turns g, the half gauge b, and u, half the difference
between the radii of right and left relative to their mean. Errors of g and u are amplified by every
circle, so both are parameters of the path. From the first pose, with phi = 0 there, it leads to

    s P,    P = integral of exp(i phi) dl

**Sensor.** A sensor at the place a in the robot's frame moves from a to s P + a exp(i phi). Its
heading in the robot is psi, so in the frame of its first pose it sees the motion

    d = exp(-i psi) (s P + a (exp(i phi) - 1))

**Units.** Columns may be in wrong units. A wrong unit of x and y changes s, and a wrong unit of
omega changes s and g alike. So g / s, whose usual value is known, tells how many units of x and y
make a metre: usual g / s over the g / s that is found. The fit has six parameters:

    log s,    log g / s,    u,    psi [rad],    a [half gauges], ahead and to the left
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np

from trackslip.drives.drive import Drive, Drives
from trackslip.intervals import DEVIATION_PER_MEDIAN
from trackslip.kinematics import Array, RobotGeometry, wrap_angle

_MOST_POINTS: Final = 3000  # most points of the integrated path besides the poses, to limit time
_MOST_MOTIONS: Final = 300  # most motions that choose the starts
# slip and errors of poses that are expected, relative to the distance and the turn [-]
_SCATTER: Final = 0.03
# the part of it that turns the robot, per distance in half gauges [rad]
_TURN_SCATTER: Final = 0.2 * _SCATTER
_HEADING_ERROR: Final = 0.02  # error of headings that is expected [rad]
_TIMING: Final = 0.2  # error of the clocks' offset that is expected between poses far apart [s]
_LARGEST_RATIO: Final = 1.5  # largest g / s of robots, and of x and y in cm or mm
_STARTS: Final = 3  # number of gains of turns from which fits start
# least and largest gain of turns of robots: skid steering with a multiplier of 6, and wrong gears
_GAINS: Final = (0.15, 2.4)
_ROUNDS: Final = 15  # number of steps of a fit
_LONGEST_STEP: Final = 1.0  # largest change of a parameter in a step
_FIRST_DAMPING: Final = 1e-3
_PARAMETERS: Final = 6  # number of parameters, each with a prior
_GAIN_PRIORS: Final = 2  # the first priors, of log s and log g / s, whose tails are long
# standard deviations of the priors of log s, log g / s, u, psi [rad] and a [half gauges]
_PRIOR: Final = np.array([3.0, 0.4, 0.03, 0.7, 2.0, 2.0])
_USUAL_RATIO: Final = -0.3  # usual log g / s: the separation multiplier of tracks is 1 to 2
_USUAL: Final = np.array([0.0, _USUAL_RATIO, 0.0, 0.0, 0.0, 0.0])  # means of the priors
_TIME_ROUNDING: Final = 1e-6  # rounding error of times [s]
_FEWEST: Final = 4  # least number of motions that tell anything
_CONVERGED: Final = 0.01  # change of the loss below which a fit has converged
_TINY: Final = 1e-12  # instead of 0 in denominators
_KNOWN: Final = 0.05  # largest standard error of log s with which the unit of lengths is known


class RelativeMotions(NamedTuple):
    """Measured motions between n pairs of poses, and the wheels' angles in between.

    With headings, a motion goes from a pose to the next, in the frame of the first. Without, there
    are two motions from each pose, to the next (first half) and to the one after (second half),
    with the axes of the world.
    """

    # (2, N) angles turned by the left and right wheels up to points of the drives [rad]
    angle: Array
    first: np.ndarray  # (n,) point at which a motion begins
    last: np.ndarray  # (n,) point at which a motion ends
    moved: np.ndarray  # (n,) motion, complex [m]; NaN if unknown
    turned: Array  # (n,) turn [rad], modulo whole circles; NaN if unknown
    duration: Array  # (n,) time that the motion takes [s]
    framed: bool  # true if the headings are known

    @classmethod
    def of(cls, drives: Sequence[Drive], clock: float) -> RelativeMotions:
        """The motions between successive poses of drives, while encoders were read."""
        # the poses with headings, or else with positions, while encoders were read
        joined = Drives.of(drives)
        time = joined.time + clock
        last_edge = np.append(joined.begins[1:], len(joined.edges)) - 1
        begins = joined.edges[joined.begins]
        ends = joined.edges[last_edge]
        is_read = time >= begins[joined.drive] - _TIME_ROUNDING
        is_read &= time <= ends[joined.drive] + _TIME_ROUNDING
        framed = bool(joined.known[1].any())
        known = joined.known[1] if framed else joined.known[0]
        rows = np.flatnonzero(is_read & known)

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
            # to the pose after the next, too; the last pose but one has none, so it has itself
            begin = np.append(begin, begin)
            end = np.concatenate([end, end[1:], end[-1:]])

        # what the poses say of each motion, if both belong to the same drive
        is_motion = (joined.drive[begin] == joined.drive[end]) & (begin != end)
        moved = np.where(is_motion, place[end] - place[begin], np.nan)
        if framed:
            moved = moved * np.exp(-1j * heading[begin])
        return cls(
            angle=np.stack(angle),
            first=np.searchsorted(points, time[begin]),
            last=np.searchsorted(points, time[end]),
            moved=moved,
            turned=np.where(is_motion, heading[end] - heading[begin], np.nan),
            duration=np.where(is_motion, time[end] - time[begin], np.inf),
            framed=framed,
        )


@dataclass(frozen=True)
class RelativeFit:
    """How well the wheels' path explains relative motions, with the best parameters."""

    loss: float  # negative logarithm of the likelihood
    explained: float  # share of the motions that are explained to within twice their scale
    speed: float | None  # s, the gain of distances; None if the motions don't determine it
    turn: float  # g, the gain of turns
    turn_ratio: float  # g / s, the inverse of the separation multiplier


def fitted(
    motions: RelativeMotions, geometry: RobotGeometry, factor: float = 1.0
) -> RelativeFit | None:
    """The best fit of the wheels' path to relative motions, from several gains of turns; None if
    there are fewer than four motions or the wheels stand still.

    Gains of turns are limited to those of robots, times a `factor` for omega in a wrong unit. Gains
    of distances are limited relative to them: else a robot that hardly moves would explain closed
    squares as well as one that drives them.
    """
    model = _Model(motions, geometry, factor)
    if model.count < _FEWEST or not model.driven.any():
        return None
    fits = [model.fit(start) for start in model.starts()]
    return min(fits, key=lambda fit: fit.loss)


class _Path(NamedTuple):
    """Motions P by the wheels' path in the frames of their first poses, and their derivatives."""

    place: np.ndarray  # (n,) complex [m], without the gain of distances
    by_gain: np.ndarray  # (n,) derivatives by the gain of turns
    by_unequal: np.ndarray  # (n,) derivatives by s u, the difference between the radii


class _Residuals(NamedTuple):
    """Residuals of n motions and of the six priors."""

    value: Array  # (3 n + 6,) in units of the scales: x, y and headings of all motions, priors
    # (3 n + 6, 6) derivatives by the parameters of what is predicted, the residuals' negative ones
    slope: Array
    scale: Array  # (3 n,) expected errors [m, m, rad]

    @property
    def of_motions(self) -> Array:
        """Residuals (3, n) of the motions: x, y and headings."""
        return self.value[:-_PARAMETERS].reshape(3, -1)

    @property
    def of_priors(self) -> Array:
        """Residuals (6,) of the priors."""
        return self.value[-_PARAMETERS:]


class _Model:
    """The wheels' path and its fit by the parameters (log s, log g / s, u, psi, a)."""

    def __init__(self, motions: RelativeMotions, geometry: RobotGeometry, factor: float) -> None:
        self._gains = factor * _GAINS[0], factor * _GAINS[1]
        left, right = motions.angle * geometry.sprocket_radius
        distance = (left + right) / 2
        self._half_gauge = geometry.half_gauge
        self._distance = distance
        self._turn = (right - left) / (2 * geometry.half_gauge)
        self._bend = distance / geometry.half_gauge  # turn by unequal radii, per s u
        self._first = motions.first
        self._last = motions.last
        self._framed = motions.framed
        # relative errors of motions: in short ones, the clocks' offset matters more
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
        values = np.zeros(_PARAMETERS)
        values[0] = np.log(gain) - _USUAL_RATIO
        if self._placed.any():
            path = np.abs(self._path(gain, 0.0).place[self._placed])
            moved = np.abs(self._moved[self._placed])
            values[0] = np.log(max(_median_ratio(moved, path), 1e-9))
        values[1] = np.log(gain) - values[0]
        return self._limited(values)

    def _path(self, gain: float, unequal: float) -> _Path:
        """The motions by the wheels' path, with derivatives."""
        # chords of arcs from point to point, with the axes of the path's start
        heading = gain * self._turn + unequal * self._bend
        middle = (heading[1:] + heading[:-1]) / 2
        chord = np.diff(self._distance) * np.sinc(np.diff(heading) / (2 * np.pi))
        ahead = chord * np.exp(1j * middle)
        into_first_frame = np.exp(-1j * heading[self._first])

        def moved(steps: np.ndarray) -> np.ndarray:
            """Sums (n,) of steps (N - 1,) over each motion, in the frame of its first pose."""
            return self._between(np.append(0.0, np.cumsum(steps))) * into_first_frame

        def turned(by: Array) -> np.ndarray:
            """Derivatives (n,) of the motions by a factor of `by` (N,) in the heading: each step
            turns with the path, and all of them back with the first pose.
            """
            at_middle = (by[1:] + by[:-1]) / 2
            return 1j * (moved(ahead * at_middle) - by[self._first] * place)

        place = moved(ahead)
        return _Path(place, turned(self._turn), turned(self._bend))

    def _residuals(self, values: Array) -> _Residuals:
        """The residuals for parameters (6,)."""
        log_speed, log_ratio, unequal_radii, yaw, arm_ahead, arm_left = values
        speed = np.exp(log_speed)  # s
        gain = np.exp(log_speed + log_ratio)  # g
        unequal = speed * unequal_radii  # s u
        arm = arm_ahead + 1j * arm_left  # a [half gauges]

        # the motions by the wheels: P, and phi at the end
        path = self._path(gain, unequal)
        turn = gain * self._between(self._turn)
        bend = self._between(self._bend)
        around = turn + unequal * bend

        # the motions of the sensor, in units of x and y; the arm turns as was measured, if it was
        into_sensor = np.exp(-1j * yaw)
        unit = speed * into_sensor
        metre = np.exp(_USUAL_RATIO - log_ratio)
        arm_turn = np.where(self._headed, self._turned, around)
        lever = metre * self._half_gauge * into_sensor * (np.exp(1j * arm_turn) - 1)
        moved_middle = unit * path.place
        explained = moved_middle + arm * lever

        # their derivatives; s is a factor of g, too, and metre falls with log g / s
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

        # residuals of the motions, in the frames of the first poses; without headings, these frames
        # are fitted, and turn with the parameters
        moved = self._moved
        if not self._framed:
            ahead = self._frames(explained)
            moved = moved * np.conj(ahead)
            slope = slope - 1j * explained[:, None] * self._turns_of_frames(slope, explained)
        missed = np.where(self._placed, moved - explained, 0.0)
        slope[~self._placed] = 0.0
        place_scale = self._scatter * speed * self.driven + _SCATTER * metre * self._half_gauge

        # residuals of the turns
        off = np.where(self._headed, wrap_angle(self._turned - around), 0.0)
        heading_slope = np.zeros((len(off), _PARAMETERS))
        heading_slope[:, 0] = around
        heading_slope[:, 1] = turn
        heading_slope[:, 2] = speed * bend
        heading_slope[~self._headed] = 0.0

        # all of them, and those of the priors
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
        by_turn = self._scatter * self._swept
        by_distance = _TURN_SCATTER * self.driven / self._half_gauge
        return np.minimum(gain * (by_turn + by_distance) + _HEADING_ERROR, np.pi)

    def _frames(self, explained: np.ndarray) -> np.ndarray:
        """Directions (n,), as complex numbers of size 1, of the frames in which motions (n,) by the
        wheels fit those measured from the same pose best.

        Two motions begin at each pose. With the measured motions m and those by the wheels d, the
        direction e that minimises sum |m - e d|^2 is that of sum m conj(d).
        """
        fit = np.where(self._placed, self._moved * np.conj(explained), 0.0)
        first, second = fit.reshape(2, -1)
        both = first + second
        ahead = both / np.maximum(np.abs(both), _TINY)
        return np.append(ahead, ahead)

    def _turns_of_frames(self, slope: np.ndarray, explained: np.ndarray) -> Array:
        """Derivatives (n, 6) of the frames' angles, from the motions' derivatives (n, 6).

        If the motions d from a pose turn by an angle, their frame turns back by it: a change dd of
        them turns the frame by -sum Im(dd conj(d)) / sum |d|^2. The result is without this sign.
        """
        known = np.where(self._placed, explained, 0.0)
        turned = (slope * np.conj(known)[:, None]).imag
        square = np.abs(known) ** 2
        turned_of_pose = turned.reshape(2, -1, _PARAMETERS).sum(axis=0)
        square_of_pose = square.reshape(2, -1).sum(axis=0)
        angle = turned_of_pose / np.maximum(square_of_pose, _TINY)[:, None]
        return np.concatenate([angle, angle])

    def fit(self, start: Array) -> RelativeFit:
        """The fit near start values (6,), by reweighted least squares whose steps are damped until
        the loss falls.
        """
        values = start
        current = self._residuals(values)
        loss = self._loss(current)
        damping = _FIRST_DAMPING
        for _ in range(_ROUNDS):
            # a step; the weights are halves of the losses' derivatives over the residuals
            weight = 1 / (1 + current.value**2)
            weight[_GAIN_PRIORS - _PARAMETERS :] = 0.5
            normal = current.slope.T @ (weight[:, None] * current.slope)
            damped = normal + damping * np.diag(np.diag(normal))
            step = np.linalg.solve(damped, current.slope.T @ (weight * current.value))
            step = np.clip(step, -_LONGEST_STEP, _LONGEST_STEP)
            new_values = self._limited(values + step)
            new = self._residuals(new_values)
            new_loss = self._loss(new)

            # it is taken only if the loss falls
            gained = loss - new_loss
            if gained <= 0:
                damping *= 10
                continue
            values = new_values
            current = new
            loss = new_loss
            damping /= 5
            if gained < _CONVERGED:
                break

        is_close = np.all(np.abs(current.of_motions) < 2, axis=0)
        is_known = self._placed | self._headed
        explained = float(np.mean(is_close[is_known]))
        speed = float(np.exp(values[0])) if self._determines_speed(current) else None
        return RelativeFit(
            loss=loss,
            explained=explained,
            speed=speed,
            turn=float(np.exp(values[0] + values[1])),
            turn_ratio=float(np.exp(values[1])),
        )

    def _limited(self, values: Array) -> Array:
        """Values (6,) with the gain of turns and its ratio to that of distances within limits."""
        limited = values.copy()
        low, high = np.log(self._gains)
        gain = np.clip(values[0] + values[1], low, high)
        limited[1] = min(values[1], np.log(_LARGEST_RATIO))
        limited[0] = gain - limited[1]
        return limited

    def _determines_speed(self, residuals: _Residuals) -> bool:
        """True if the motions determine the gain of distances."""
        if not self._placed.any():
            return False
        size = np.abs(residuals.of_motions[:2, self._placed])
        # the scatter may be far below what was expected
        scatter = float(np.clip(DEVIATION_PER_MEDIAN * np.median(size), 0.02, 1.0))
        normal = residuals.slope.T @ residuals.slope
        return bool(scatter * np.sqrt(np.linalg.inv(normal)[0, 0]) < _KNOWN)

    def _loss(self, residuals: _Residuals) -> float:
        """Negative log-likelihood of residuals, up to a constant.

        Without headings, most motions between neighbouring poses are in two motions, which count
        half. The priors of both gains have long tails, for units of any size; the other priors are
        normal.
        """
        is_known = np.stack([self._placed, self._placed, self._headed])
        scale = residuals.scale.reshape(3, -1)
        of_motions = _negative_log_likelihood(residuals.of_motions * scale, scale)
        share = 1.0 if self._framed else 0.5
        by_motions = share * of_motions[is_known].sum()

        of_gains = residuals.of_priors[:_GAIN_PRIORS]
        of_others = residuals.of_priors[_GAIN_PRIORS:]
        by_priors = np.log1p(of_gains**2).sum() + 0.5 * np.sum(of_others**2)
        return float(by_motions + by_priors)


def _median_ratio(values: Array, by: Array) -> float:
    """Median of the ratios of values (n,) to others (n,), weighted by the others."""
    ratio = values / np.maximum(by, 1e-12)
    order = np.argsort(ratio)
    weight = np.cumsum(by[order])
    return float(ratio[order[np.searchsorted(weight, weight[-1] / 2)]])


def _negative_log_likelihood(missed: Array, scale: Array) -> Array:
    """Cauchy's negative log-likelihood of residuals with scales, up to a constant."""
    return np.asarray(np.log(scale) + np.log1p((missed / scale) ** 2))
