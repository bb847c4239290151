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
from trackslip.intervals import DEVIATION_PER_MEDIAN
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
_PLATE_MARGIN: Final = 0.1
_MIN_RETURNS: Final = 8  # fewest returns of a scan from which the noise is estimated
# distances, in valid poses, to earlier and later poses with which a pose is compared
_COMPARED: Final = (1, 2, 3, 4)
_MIN_LOCATED: Final = 12  # fewest scans in which the plate must be located
# net lead of one end, as a fraction of the distance driven, above which this end is the front
_MIN_LEAD: Final = 0.3
_MIN_ANGLE: Final = 1e-9  # angle of the sprockets above which a ratio to it counts [rad]


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
        beams = ranges.shape[1]
        angle_min = message.angle_min
        increment = message.angle_increment
        span = abs(increment) * (beams - 1)
        if not (np.isfinite(angle_min) and 0 < span < 2 * np.pi + abs(increment)):
            found = f"angle_min = {angle_min:g}, angle_increment = {increment:g} for {beams} beams"
            raise LogError(f"{found}: must be at most a full circle [rad]")

        reach = np.float32(message.range_max if message.range_max > 0 else np.inf)
        nearest = np.float32(message.range_min)
        is_return = (ranges > 0) & (ranges >= nearest) & (ranges < reach)
        if not is_return.any():
            raise LogError("its scans have no return")

        # anticlockwise, whichever way the scanner turns and is mounted
        numbers = np.arange(beams)
        bearings = (angle_min + increment * numbers) * (-1.0 if upside_down else 1.0)
        lag = max(message.time_increment, 0.0) * numbers
        order = np.argsort(bearings)
        return cls(
            time=np.asarray(time, float),
            bearings=bearings[order],
            ranges=np.where(is_return, ranges, np.float32(np.nan))[:, order],
            lag=lag[order],
            max_range=float(reach),
        )

    def seen(self, level: Array, noise: float, rows: np.ndarray | slice = slice(None)) -> Scan:
        """The scans `rows` with a background `level` (B,); at edges, beams may measure their
        neighbours' background.
        """
        padded = np.pad(level, 1, constant_values=np.nan)
        before = padded[:-2]
        after = padded[2:]
        return Scan(
            bearings=self.bearings,
            ranges=self.ranges[rows].astype(float),
            noise=noise,
            mount=np.zeros(3),
            max_range=self.max_range,
            background=np.stack([level, before, after]),
        )

    def opened(self, busy: np.ndarray) -> RawScans:
        """Rotate full-circle scans to begin in the quarter with least motion, so that their ends
        don't cut the plate.

        `busy` (B,) is the number of moving returns in each beam. Scans of less than a full circle
        remain unchanged.
        """
        beams = len(busy)
        span = self.bearings[-1] - self.bearings[0]
        step = span / (beams - 1)
        if span < 2 * np.pi - 1.5 * step:
            return self
        # motion in the quarter around each beam, all round the circle
        three_rounds = np.convolve(np.tile(busy, 3), np.ones(beams // 4), "same")
        motion = three_rounds[beams : 2 * beams]
        order = np.roll(np.arange(beams), -int(np.argmin(motion)))
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
    # scans between which the sprockets turn equally, and from which of them the returns move
    turns = np.abs(np.diff(angle, axis=0)).max(axis=1)
    turned = np.append(0.0, turns.cumsum())
    places = np.linspace(0.0, turned[-1], _KEY_SCANS)
    keys = np.unique(np.searchsorted(turned, places))
    moving = returns_of(raw.seen(background(raw.ranges[keys]), _FIRST_NOISE, keys))
    raw = raw.opened(np.bincount(moving.beam, minlength=len(raw.bearings)))

    # the plate, then background and noise without it, and again
    locator = PlateLocator(plate)
    level = background(raw.ranges[keys])
    noise = _FIRST_NOISE
    for _ in range(_ROUNDS):
        scan = raw.seen(level, noise, keys)
        estimate = locator.locate(scan)
        level = background(_without_plate(scan, plate, estimate))
        noise = _scatter(scan, plate, estimate)

    # the plate in all scans, where the encoders agree
    scan = raw.seen(level, noise)
    estimate = locator.locate(scan)
    tracks, turn = _driven(angle, estimate)
    estimate.valid[:] = _plausible(tracks, turn, estimate)
    if noise > _MAX_NOISE or estimate.valid.sum() < _MIN_LOCATED:
        size = f"{plate.length:g}x{plate.thickness:g} m"
        scans = counted(len(raw.time), "scan")
        raise LogError(f"no plate of {size} moves as the encoders say in its {scans}")

    notes = []
    turn_of_sprockets = angle[:, 1] - angle[:, 0]
    if np.sum(np.diff(turn) * np.diff(turn_of_sprockets)) < 0:
        notes.append(
            "the plate turns against the sprockets: are left and right swapped, or the scanner "
            "upside down?"
        )
    if not _turn_round(tracks, turn, estimate):
        notes.append(
            "the robot only turns on the spot: which end of the plate is the front one isn't known"
        )

    between = _interpolated(raw.time, estimate)
    return FollowedPlate(
        time=raw.time + _delays(raw, between),
        estimate=estimate,
        cluster=returns_at(scan, plate, between),
        scanner=replace(scan, ranges=scan.ranges[:0], background=None),
        notes=tuple(notes),
    )


def _interpolated(time: Array, estimate: PoseEstimate) -> Array:
    """Poses (S, 3) at all times (S,) [s], interpolated between the valid ones."""
    rows = np.flatnonzero(estimate.valid)
    columns = [np.interp(time, time[rows], column) for column in estimate.pose[rows].T]
    return np.stack(columns, axis=-1)


def _delays(raw: RawScans, pose: Array) -> Array:
    """Delays (S,) [s] from the first ray of each scan to the beam that hits a plate at pose (S,
    3).
    """
    sight = np.arctan2(pose[:, 1], pose[:, 0])
    first = raw.bearings[0]
    bearing = first + (sight - first) % (2 * np.pi)
    return np.interp(bearing, raw.bearings, raw.lag)


def background(ranges: np.ndarray) -> Array:
    """Ranges (B,) of the background in scans (S, B) between which the robot has moved; NaN where
    there is none.

    The background is the median range if most ranges are close to the median. In `ranges`, NaN is
    no return and -inf a return from the plate, which is ignored.
    """
    seen = np.where(np.isnan(ranges), np.inf, ranges)  # no return counts as the farthest
    seen[ranges == -np.inf] = np.nan  # ignored by the medians
    is_ignored = np.isnan(seen).all(axis=0)
    seen[:, is_ignored] = np.inf
    level = np.nanmedian(seen, axis=0)

    is_known = np.isfinite(level)
    away = np.abs(seen[:, is_known] - level[is_known])
    deviation = DEVIATION_PER_MEDIAN * np.nanmedian(away, axis=0)
    is_known[is_known] = deviation < _MAX_NOISE
    return np.where(is_known, level, np.nan)


def _without_plate(scan: Scan, plate: Plate, estimate: PoseEstimate) -> Array:
    """Ranges (S, B) in which returns from the located plates and near them are replaced by -inf."""
    returns = returns_of(replace(scan, background=None))
    outside = plate.outside(estimate.pose, returns.row, returns.x, returns.y)
    is_plate = estimate.valid[returns.row] & (outside < _PLATE_MARGIN)
    ranges = scan.ranges.copy()
    ranges[returns.row[is_plate], returns.beam[is_plate]] = -np.inf
    return ranges


def _scatter(scan: Scan, plate: Plate, estimate: PoseEstimate) -> float:
    """Standard deviation of ranges about the located plates [m], or the noise of the scan if
    returns are too few.

    In each scan, the sum of the n squared residuals is distributed like noise^2 chi^2 with n - 2
    degrees of freedom, because the fit of a face has two parameters. The median over the scans,
    relative to that of chi^2, isn't affected by scans with other objects.
    """
    pose = estimate.pose[estimate.valid]
    located = replace(scan, ranges=scan.ranges[estimate.valid])
    cluster = extract_plate(located, plate, pose)
    full = np.flatnonzero(cluster.count >= _MIN_RETURNS)
    if not full.size:
        return scan.noise

    count = cluster.count[full]
    beams = PlateBeams.of(scan, cluster.take(full))
    misfit = PlateLikelihood(plate, huber=np.inf).misfit(beams, pose[full])
    squares = misfit**2 * count
    freedom = count - 2
    # median of chi squared (Wilson and Hilferty, 1931)
    median = freedom * (1 - 2 / (9 * freedom)) ** 3
    return beams.noise * float(np.sqrt(np.median(squares / median)))


def _driven(angle: Array, estimate: PoseEstimate) -> tuple[Array, Array]:
    """Distances (S, 2) driven by the tracks [m] and headings (S,) of the plate [rad], according to
    the encoders.

    The distance per sprocket angle, and the turn per difference of the angles `angle` (S, 2) [rad],
    are the medians over the motions between each valid pose and the next but one. The heading of a
    plate is known up to half turns, so its turns are wrapped to a quarter turn.
    """
    rows = np.flatnonzero(estimate.valid)
    later = rows[2:]
    earlier = rows[:-2]
    moved = estimate.pose[later] - estimate.pose[earlier]
    left, right = (angle[later] - angle[earlier]).T

    distance = np.hypot(moved[:, 0], moved[:, 1])
    turn = se2.wrap_angle(2 * moved[:, 2]) / 2
    distance_per_angle = _median_ratio(distance, np.abs(left + right) / 2)
    turn_per_angle = _median_ratio(turn, right - left)
    return distance_per_angle * angle, turn_per_angle * (angle[:, 1] - angle[:, 0])


def _median_ratio(y: Array, x: Array) -> float:
    """Median of y / x weighted by |x|, which is the slope with the smallest absolute residuals; 0
    if all x are 0.
    """
    moves = np.abs(x) > _MIN_ANGLE
    if not moves.any():
        return 0.0
    ratio = y[moves] / x[moves]
    weight = np.abs(x[moves])
    order = np.argsort(ratio)
    middle = np.searchsorted(np.cumsum(weight[order]), weight.sum() / 2)
    return float(ratio[order[middle]])


def _plausible(tracks: Array, turn: Array, estimate: PoseEstimate) -> np.ndarray:
    """Mask (S,) of the valid poses that agree with most of the valid poses next to them.

    Two poses agree if the turn between them matches the encoders and their distance is at most the
    faster track's.
    """
    rows = np.flatnonzero(estimate.valid)
    votes = np.zeros(len(turn))
    for places in _COMPARED:
        first = rows[:-places]
        second = rows[places:]
        moved = estimate.pose[second] - estimate.pose[first]
        distance = np.hypot(moved[:, 0], moved[:, 1])
        expected_turn = turn[second] - turn[first]
        missed_turn = se2.wrap_angle(2 * (moved[:, 2] - expected_turn)) / 2  # up to half turns

        farthest = (1 + GROWTH) * np.abs(tracks[second] - tracks[first]).max(axis=1)
        is_near = distance < GATE_POSITION + farthest
        is_aligned = np.abs(missed_turn) < GATE_HEADING + GROWTH * np.abs(expected_turn)
        vote = np.where(is_near & is_aligned, 1, -1)
        votes[first] += vote
        votes[second] += vote
    return estimate.valid & (votes > 0)


def _turn_round(tracks: Array, turn: Array, estimate: PoseEstimate) -> bool:
    """Unwrap valid headings in place and point them to the front of the robot; False if the front
    isn't known.

    The encoders resolve half turns between poses. Where poses are too far apart, a new piece with
    its own front begins. In a piece, the end of the plate that leads while the sprockets turn
    forwards is the front one.
    """
    rows = np.flatnonzero(estimate.valid)
    expected = turn[rows]
    begins_piece = GROWTH * np.abs(np.diff(expected)) > BLIND_TURN
    piece = np.append(0, np.cumsum(begins_piece))
    heading = np.unwrap(estimate.pose[rows, 2] - expected, period=np.pi) + expected

    # motion from pose to pose: along the heading, while the sprockets turn forwards or backwards
    moved = np.diff(estimate.pose[rows, :2], axis=0)
    ahead = np.sum(moved * se2.direction(heading[1:]), axis=1)
    driven = np.diff(tracks[rows].mean(axis=1))

    def sum_per_piece(values: Array) -> Array:
        """Sums of the values of motions within each piece."""
        inside = np.where(begins_piece, 0.0, values)
        return np.asarray(np.bincount(piece[1:], inside, piece[-1] + 1), float)

    lead = sum_per_piece(ahead * np.sign(driven))
    distance = sum_per_piece(np.abs(driven))
    is_backwards = lead < -_MIN_LEAD * distance
    is_forwards = lead > _MIN_LEAD * distance
    estimate.pose[rows, 2] = heading + np.where(is_backwards, np.pi, 0.0)[piece]
    return bool((is_backwards | is_forwards).any())
