"""The plate in the raw scans of a stationary laser range finder.

Motion distinguishes the plate from its surroundings. A range that a beam measures in most scans, at
different poses of the robot, is background and ignored. The plate is located in each scan
independently, and poses that contradict the encoders are rejected. No calibration is needed:
distances and turns of the plate per sprocket radian are measured.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, Final

import numpy as np

from trackslip import se2
from trackslip.errors import LogError, counted
from trackslip.kinematics import Array
from trackslip.localization.likelihood import PlateBeams, PlateLikelihood
from trackslip.localization.plate import PlateLocator
from trackslip.localization.pose_estimate import PoseEstimate
from trackslip.localization.pose_tracker import BLIND_TURN, GATE_HEADING, GATE_POSITION, GROWTH
from trackslip.localization.scan import Cluster, Plate, Scan, extract_plate, returns_at, returns_of

# number of scans for the background, equal sprocket turns apart because a robot may rest
_KEY_SCANS: Final = 400
# noise assumed until the scanner's noise is estimated from the plate [m]
_FIRST_NOISE: Final = 0.02
# above the noise of any scanner; ranges that scatter more are not from a fixed object [m]
_MAX_NOISE: Final = 0.04
# number of alternations between locating the plate and estimating background and noise
_ROUNDS: Final = 3
# distance from the plate within which returns are not used for the background [m]
_ABOUT: Final = 0.1
_MIN_RETURNS: Final = 8  # fewest returns of a scan from which the noise is estimated
# distances, in valid poses, to earlier and later poses with which a pose is compared
_COMPARED: Final = (1, 2, 3, 4)
_MIN_LOCATED: Final = 12  # fewest scans in which the plate must be located
# net lead of one end, as a fraction of the distance driven, above which this end is the front
_TOLD: Final = 0.3


@dataclass(frozen=True)
class RawScans:
    """The S scans of a session, with B beams each."""

    time: Array  # (S,) times of the first rays, ascending [s]
    # (B,) bearings of the beams in the scanner's frame, equally spaced, ascending [rad]
    bearings: Array
    ranges: np.ndarray  # (S, B) float32, NaN for no return [m]
    lag: Array  # (B,) delay from the first ray to each beam [s]
    max_range: float  # distance beyond which objects give no return [m]

    @classmethod
    def measured(
        cls, time: Array, ranges: np.ndarray, message: Any, upside_down: bool = False
    ) -> RawScans:
        """Build scans from ranges (S, B), times (S,) of first rays, and a `sensor_msgs/LaserScan`
        with the settings.

        A range is no return if it is not finite, 0, below `range_min`, or not below `range_max`
        (REP 117). Beams may run clockwise. Raises LogError for scans without beams, angles or
        returns.
        """
        beams, angle_min, angle_increment = (
            ranges.shape[1],
            message.angle_min,
            message.angle_increment,
        )
        span = abs(angle_increment) * (beams - 1)
        if not (np.isfinite(angle_min) and 0 < span < 2 * np.pi + abs(angle_increment)):
            what = (
                f"angle_min = {angle_min:g}, angle_increment = {angle_increment:g} for "
                f"{beams} beams"
            )
            raise LogError(f"{what}: must be at most a full circle [rad]")
        reach = np.float32(message.range_max if message.range_max > 0 else np.inf)
        returned = (ranges > 0) & (ranges >= np.float32(message.range_min)) & (ranges < reach)
        if not returned.any():
            raise LogError("its scans have no return")
        bearings = (angle_min + angle_increment * np.arange(beams)) * (-1.0 if upside_down else 1.0)
        order, lag = np.argsort(bearings), max(message.time_increment, 0.0) * np.arange(beams)
        kept = np.where(returned, ranges, np.float32(np.nan))[:, order]
        return cls(np.asarray(time, float), bearings[order], kept, lag[order], float(reach))

    def seen(self, level: Array, noise: float, rows: np.ndarray | slice = slice(None)) -> Scan:
        """The scans `rows` with a background `level` (B,); at edges, beams may measure their
        neighbours' background.
        """
        beside = np.pad(level, 1, constant_values=np.nan)
        levels, ranges = np.stack([level, beside[:-2], beside[2:]]), self.ranges[rows].astype(float)
        return Scan(self.bearings, ranges, noise, np.zeros(3), self.max_range, background=levels)

    def opened(self, busy: np.ndarray) -> RawScans:
        """Rotate full-circle scans to begin in the quarter with least motion, so that their ends
        don't cut the plate.

        `busy` (B,) is the number of moving returns in each beam. Scans of less than a full circle
        remain unchanged.
        """
        beams, span = len(busy), self.bearings[-1] - self.bearings[0]
        step = span / (beams - 1)
        if span < 2 * np.pi - 1.5 * step:
            return self
        around = np.convolve(np.tile(busy, 3), np.ones(beams // 4), "same")[beams : 2 * beams]
        order = np.roll(np.arange(beams), -int(np.argmin(around)))
        bearings = self.bearings[order[0]] + step * np.arange(beams)
        return replace(self, bearings=bearings, ranges=self.ranges[:, order], lag=self.lag[order])


@dataclass(frozen=True)
class FollowedPlate:
    """The plate in each of S scans, in the scanner's frame."""

    time: Array  # (S,) times at which the beams hit the plate [s]
    # (S,) headings unwrapped, pointing to the end that leads as the sprockets turn forwards
    estimate: PoseEstimate
    cluster: Cluster  # (S,) the returns from the plate
    scanner: Scan  # bearings and noise of the scanner; no ranges
    notes: tuple[str, ...]  # one line for each doubt


def follow_plate(raw: RawScans, angle: Array, plate: Plate) -> FollowedPlate:
    """Find the poses of a plate of known size in all scans.

    `angle` (S, 2) are the sprocket angles at the time of each scan [rad]. Raises LogError if the
    sprockets hardly turn, or if no plate of this size moves as the encoders indicate.
    """
    turned = np.append(0.0, np.abs(np.diff(angle, axis=0)).max(axis=1).cumsum())
    keys = np.unique(np.searchsorted(turned, np.linspace(0.0, turned[-1], _KEY_SCANS)))
    moving = returns_of(raw.seen(background(raw.ranges[keys]), _FIRST_NOISE, keys))
    raw = raw.opened(np.bincount(moving.beam, minlength=len(raw.bearings)))
    level, noise = background(raw.ranges[keys]), _FIRST_NOISE
    for _ in range(_ROUNDS):
        scan = raw.seen(level, noise, keys)
        estimate = PlateLocator(plate).locate(scan)
        level, noise = (
            background(_without_plate(scan, plate, estimate)),
            _scatter(scan, plate, estimate),
        )
    scan = raw.seen(level, noise)
    estimate = PlateLocator(plate).locate(scan)
    tracks, turn = _driven(angle, estimate)
    estimate.valid[:] = _plausible(tracks, turn, estimate)
    if noise > _MAX_NOISE or estimate.valid.sum() < _MIN_LOCATED:
        size = f"{plate.length:g}x{plate.thickness:g} m"
        raise LogError(
            f"no plate of {size} moves as the encoders say in its {counted(len(raw.time), 'scan')}"
        )
    notes = []
    if np.sum(np.diff(turn) * np.diff(angle[:, 1] - angle[:, 0])) < 0:
        notes.append(
            "the plate turns against the sprockets: are left and right swapped, or the scanner "
            "upside down?"
        )
    if not _turn_round(tracks, turn, estimate):
        notes.append(
            "the robot only turns on the spot: which end of the plate is the front one isn't known"
        )
    rows = np.flatnonzero(estimate.valid)
    between = np.stack(
        [np.interp(raw.time, raw.time[rows], column) for column in estimate.pose[rows].T], axis=-1
    )
    sight = np.arctan2(between[:, 1], between[:, 0])
    time = raw.time + np.interp(
        raw.bearings[0] + (sight - raw.bearings[0]) % (2 * np.pi), raw.bearings, raw.lag
    )
    scanner = replace(scan, ranges=scan.ranges[:0], background=None)
    return FollowedPlate(time, estimate, returns_at(scan, plate, between), scanner, tuple(notes))


def background(ranges: np.ndarray) -> Array:
    """Ranges (B,) of the background in scans (S, B) between which the robot has moved; NaN where
    there is none.

    The background is the median range if most ranges are close to the median. In `ranges`, NaN is
    no return and -inf a return from the plate, which is ignored.
    """
    seen = np.where(np.isnan(ranges), np.inf, ranges)
    seen[ranges == -np.inf] = np.nan
    seen[:, np.isnan(seen).all(axis=0)] = np.inf
    level = np.nanmedian(seen, axis=0)
    known = np.isfinite(level)
    known[known] = 1.4826 * np.nanmedian(np.abs(seen[:, known] - level[known]), axis=0) < _MAX_NOISE
    return np.where(known, level, np.nan)


def _without_plate(scan: Scan, plate: Plate, estimate: PoseEstimate) -> Array:
    """Ranges (S, B) in which returns from the located plates and near them are replaced by -inf."""
    returns, ranges = returns_of(replace(scan, background=None)), scan.ranges.copy()
    near = estimate.valid[returns.row] & (
        plate.outside(estimate.pose, returns.row, returns.x, returns.y) < _ABOUT
    )
    ranges[returns.row[near], returns.beam[near]] = -np.inf
    return ranges


def _scatter(scan: Scan, plate: Plate, estimate: PoseEstimate) -> float:
    """Standard deviation of ranges about the located plates [m], or the noise of the scan if
    returns are too few.
    """
    pose, ranges = estimate.pose[estimate.valid], scan.ranges[estimate.valid]
    cluster = extract_plate(replace(scan, ranges=ranges), plate, pose)
    full = np.flatnonzero(cluster.count >= _MIN_RETURNS)
    if not full.size:
        return scan.noise
    beams, count = PlateBeams.of(scan, cluster.take(full)), cluster.count[full]
    squares = PlateLikelihood(plate, np.inf).misfit(beams, pose[full]) ** 2 * count
    freedom = count - 2  # the fit of a face has two parameters
    # median of chi squared (Wilson and Hilferty, 1931)
    median = freedom * (1 - 2 / (9 * freedom)) ** 3
    return beams.noise * float(np.sqrt(np.median(squares / median)))


def _driven(angle: Array, estimate: PoseEstimate) -> tuple[Array, Array]:
    """Distances (S, 2) driven by the tracks [m] and headings (S,) of the plate [rad], according to
    the encoders.
    """
    rows = np.flatnonzero(estimate.valid)
    moved, (left, right) = (
        estimate.pose[rows[2:]] - estimate.pose[rows[:-2]],
        (angle[rows[2:]] - angle[rows[:-2]]).T,
    )
    distance = _median_ratio(np.hypot(moved[:, 0], moved[:, 1]), np.abs(left + right) / 2)
    turn = _median_ratio(se2.wrap_angle(2 * moved[:, 2]) / 2, right - left)
    return distance * angle, turn * (angle[:, 1] - angle[:, 0])


def _median_ratio(y: Array, x: Array) -> float:
    """Median of y / x weighted by |x|, which is the slope with the smallest absolute residuals; 0
    if all x are 0.
    """
    moves = np.abs(x) > 1e-9
    ratio, weight = y[moves] / x[moves], np.abs(x[moves])
    order = np.argsort(ratio)
    middle = np.searchsorted(np.cumsum(weight[order]), weight.sum() / 2)
    return float(ratio[order[middle]]) if moves.any() else 0.0


def _plausible(tracks: Array, turn: Array, estimate: PoseEstimate) -> np.ndarray:
    """Mask (S,) of the valid poses that agree with most of the valid poses next to them.

    Two poses agree if the turn between them matches the encoders and their distance is at most the
    faster track's.
    """
    rows = np.flatnonzero(estimate.valid)
    votes = np.zeros(len(turn))
    for apart in _COMPARED:
        first, second = rows[:-apart], rows[apart:]
        moved, turned = estimate.pose[second] - estimate.pose[first], turn[second] - turn[first]
        reach = (1 + GROWTH) * np.abs(tracks[second] - tracks[first]).max(axis=1)
        agree = np.hypot(moved[:, 0], moved[:, 1]) < GATE_POSITION + reach
        agree &= np.abs(
            se2.wrap_angle(2 * (moved[:, 2] - turned)) / 2
        ) < GATE_HEADING + GROWTH * np.abs(turned)
        votes[first] += np.where(agree, 1, -1)
        votes[second] += np.where(agree, 1, -1)
    return estimate.valid & (votes > 0)


def _turn_round(tracks: Array, turn: Array, estimate: PoseEstimate) -> bool:
    """Unwrap valid headings in place and point them to the front of the robot; False if the front
    isn't known.

    The encoders resolve half turns between poses. Where poses are too far apart, a new piece with
    its own front begins.
    """
    rows = np.flatnonzero(estimate.valid)
    piece = np.append(0, np.cumsum(GROWTH * np.abs(np.diff(turn[rows])) > BLIND_TURN))
    heading = np.unwrap(estimate.pose[rows, 2] - turn[rows], period=np.pi) + turn[rows]
    moved, driven = np.diff(estimate.pose[rows, :2], axis=0), np.diff(tracks[rows].mean(axis=1))
    ahead = np.sum(moved * se2.direction(heading[1:]), axis=1) * np.sign(driven)
    led, whole = (
        np.bincount(piece[1:], x * (np.diff(piece) == 0), piece[-1] + 1)
        for x in (ahead, np.abs(driven))
    )
    estimate.pose[rows, 2] = heading + np.where(led < -_TOLD * whole, np.pi, 0.0)[piece]
    return bool((np.abs(led) > _TOLD * whole).any())
