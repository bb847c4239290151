"""From the scans of a session and the encoders to the poses of the plate: background, plate, motion, front end."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from trackslip import se2
from trackslip.errors import LogError
from trackslip.kinematics import Array
from trackslip.localization.base import PoseEstimate
from trackslip.localization.beams import PlateBeams
from trackslip.localization.likelihood import PlateLikelihood
from trackslip.localization.plate import PlateLocator
from trackslip.localization.scan import Cluster, Plate, Scan, extract_plate
from trackslip.rangefinder.background import Background, background_of
from trackslip.rangefinder.links import Chain, carried, consistent, headings
from trackslip.rangefinder.moving import Moving, around_plate, cut_where_nothing_moves, moving_things, straightened
from trackslip.rangefinder.plate_motion import PlateMotion, Turned, plate_motion
from trackslip.rangefinder.series import ScanSeries

_KEY_SCANS = 400  # from which the background is taken
_MIN_TURNED = 3.0  # of a sprocket in a session, for the background to show [rad]
_FIRST_NOISE = 0.02  # until the plate tells the noise of a scanner without background [m]
_MIN_RETURNS = 8  # of a scan that tells the noise
_AT_ONCE = 2000  # scans that are located together, which bounds the memory
_MIN_LOCATED = 12  # scans
_MAX_SCATTER = 0.04  # of ranges about a plate, more than any scanner's noise [m]
_MIN_DRIVEN = 0.3  # way forwards and backwards from which the front end shows [m]
_ROUNDS = 4  # of the background without the plate, and the plate without the background, at most
_SETTLED = 0.05  # change of the noise that needs no further round [-]
_NO_OUTLIER = 1e6  # residual of a range [standard deviations]
_BESIDE = 0.02  # half the time over which the speed of a sprocket is taken [s]


@dataclass(frozen=True)
class Sighting:
    """The plate in each of S scans."""

    series: ScanSeries
    time: Array  # (S,) when the beams met the plate [s]
    estimate: PoseEstimate  # (S,) in the scanner's frame, headings with the front ahead and unwrapped
    cluster: Cluster  # (S,) the returns attributed to the plate
    scan: Scan
    """The scanner as it was found to be, without ranges."""
    background: Background
    motion: PlateMotion
    """Motion of the plate per turn of the sprockets."""
    moving: Moving
    """Moving objects."""
    scatter: float
    """Standard deviation of the ranges on the plate about it [m]."""
    front: bool
    """True if the front end of the plate is known, which it is not if the robot only turns on the spot."""


@dataclass(frozen=True)
class _Track:
    """The plate in S scans, as far as it is known."""

    estimate: PoseEstimate  # (S,)
    expected: Array  # (S, 3) where the encoders lead the plate from the nearest pose
    near: np.ndarray  # (S,) bool: whether that is from a pose close in time
    motion: PlateMotion
    front: bool
    """True if the front end of the plate is known."""


def sight_plate(series: ScanSeries, turned: Turned, plate: Plate, noise: float | None = None) -> Sighting:
    """The poses of the plate in all scans of a session, in the scanner's frame.

    The background is found first, from scans between which the robot has moved, then again without the returns around
    the plate. Poses that contradict the encoders are looked for again where the encoders lead.

    Args:
        series: the scans, all within the time of the encoders.
        turned: how far the sprockets have turned.
        plate: its size.
        noise: standard deviation of a range [m]; by default that of ranges to the background or, without one, to the
            plate.

    Raises:
        LogError: if the robot hardly moves, or no plate of this size is found.
    """
    angle = turned.at(series.time)
    background = background_of(series.ranges[_key_scans(angle)])
    if series.is_full_circle:
        series = cut_where_nothing_moves(series, background)
        background = background_of(series.ranges[_key_scans(angle)])
    scanner = _scanner(series, background, noise or background.noise or _FIRST_NOISE)
    track = _track(scanner, series, plate, angle)
    for _ in range(_ROUNDS):
        background = _behind(series, plate, track)
        found = noise or background.noise or _scatter(scanner, series, plate, track.estimate)
        settled = abs(found / scanner.noise - 1) < _SETTLED
        scanner = _scanner(series, background, found)
        track = _track(scanner, series, plate, angle)
        if settled:
            break
    rate = _rates(track, turned, series.time)
    pose = np.where(track.estimate.valid[:, None], track.estimate.pose, track.expected)
    ranges = straightened(series.ranges, series.bearings, series.lag, plate, pose, rate, scanner.noise)
    estimate = track.estimate
    if ranges is not series.ranges:
        series = replace(series, ranges=ranges)
        estimate = _relocated(scanner, series, plate, track)
    scatter = _scatter(scanner, series, plate, estimate)
    if scatter > _MAX_SCATTER:
        raise _no_plate(scanner, series, plate, estimate)
    time = series.time + np.interp(_bearing(series, pose), series.bearings, series.lag)
    whole = replace(scanner, ranges=series.ranges)
    cluster = _clusters(whole, plate, np.where(estimate.valid[:, None], estimate.pose, track.expected), track)
    moving = moving_things(whole, plate, pose, track.near)
    return Sighting(series, time, estimate, cluster, scanner, background, track.motion, moving, scatter, track.front)


def _key_scans(angle: Array) -> np.ndarray:
    """Scans between which the sprockets turn equally far; raises LogError if they hardly turn."""
    turned = np.append(0.0, np.cumsum(np.abs(np.diff(angle, axis=0)).max(axis=1)))
    if turned[-1] < _MIN_TURNED:
        what = f"the sprockets turn by {turned[-1]:.2g} rad while it scans, at least {_MIN_TURNED:g} are needed"
        raise LogError(f"{what}: plate and background differ by their motion alone")
    return np.unique(np.searchsorted(turned, np.linspace(0.0, turned[-1], _KEY_SCANS)))


def _scanner(series: ScanSeries, background: Background, noise: float) -> Scan:
    """The scanner in its own frame, without ranges."""
    none, origin = np.empty((0, len(series.bearings))), np.zeros(3)
    levels, tolerance = background.levels, background.tolerance(noise)
    return Scan(series.bearings, none, noise, origin, series.max_range, background.dropout, levels, tolerance)


def _track(scanner: Scan, series: ScanSeries, plate: Plate, angle: Array) -> _Track:
    """The plate in all scans, located independently and, where that contradicts the encoders, near their prediction."""
    estimate = _located(scanner, series, plate)
    valid = np.flatnonzero(estimate.valid)
    motion = plate_motion(series.time[valid], angle[valid], estimate.pose[valid])
    if motion is None:
        raise _no_plate(scanner, series, plate, estimate)
    reckoned = motion.path(angle)
    chain = _chain(series, estimate, reckoned)
    if chain is None:
        raise _no_plate(scanner, series, plate, estimate)
    expected, near = carried(chain, series.time, reckoned)
    again = np.flatnonzero(~estimate.valid & near)
    if again.size:
        _put(estimate, again, _located(scanner, series.take(again), plate, expected[again]))
        chain = _chain(series, estimate, reckoned) or chain
    rows = np.flatnonzero(estimate.valid)
    heading, known = headings(chain, motion, angle[rows])
    estimate.pose[rows, 2] = heading
    if known.any():
        estimate.valid[rows[~known]] = False
    chain = replace(chain, pose=estimate.pose[rows])
    expected, near = carried(chain, series.time, reckoned)
    driven = 0.5 * np.abs(np.diff(angle.sum(axis=1))).sum() * float(np.abs(motion.matrix[0].sum()))
    return _Track(estimate, expected, near, motion, bool(known.any()) and driven > _MIN_DRIVEN)


def _chain(series: ScanSeries, estimate: PoseEstimate, reckoned: Array) -> Chain | None:
    """The poses that agree with the encoders; the others are marked, in place, as not valid. None for too few."""
    rows = np.flatnonzero(estimate.valid)
    agreed = consistent(Chain(series.time[rows], estimate.pose[rows], reckoned[rows]))
    estimate.valid[rows[~agreed]] = False
    rows = rows[agreed]
    return Chain(series.time[rows], estimate.pose[rows], reckoned[rows]) if len(rows) >= _MIN_LOCATED else None


def _located(scanner: Scan, series: ScanSeries, plate: Plate, expected: Array | None = None) -> PoseEstimate:
    """Poses (S,) in the scans, a part of them at a time."""
    locator = PlateLocator(plate)
    parts = []
    for begin in range(0, len(series.time), _AT_ONCE):
        rows = slice(begin, begin + _AT_ONCE)
        part = replace(scanner, ranges=series.ranges[rows].astype(float))
        parts.append(locator.locate(part, None if expected is None else expected[rows]))
    return PoseEstimate(*(np.concatenate(arrays) for arrays in zip(*(vars(p).values() for p in parts), strict=True)))


def _relocated(scanner: Scan, series: ScanSeries, plate: Plate, track: _Track) -> PoseEstimate:
    """Poses of corrected scans, near the poses of the uncorrected ones."""
    rows = np.flatnonzero(track.estimate.valid)
    before = track.estimate.pose[rows]
    again = _located(scanner, series.take(rows), plate, before)
    again.pose[:, 2] -= np.pi * np.round((again.pose[:, 2] - before[:, 2]) / np.pi)
    estimate = replace(track.estimate, valid=np.zeros_like(track.estimate.valid))
    _put(estimate, rows, again)
    return estimate


def _put(estimate: PoseEstimate, rows: np.ndarray, other: PoseEstimate) -> None:
    """Overwrite the rows `rows`, in place."""
    for mine, others in zip(vars(estimate).values(), vars(other).values(), strict=True):
        mine[rows] = others


def _behind(series: ScanSeries, plate: Plate, track: _Track) -> Background:
    """The background, without the returns around the plate."""
    rows = np.flatnonzero(track.estimate.valid)
    rows = rows[:: -(-len(rows) // (2 * _KEY_SCANS))]
    ranges = series.ranges[rows]
    return background_of(ranges, around_plate(series.bearings, ranges, plate, track.estimate.pose[rows]))


def _scatter(scanner: Scan, series: ScanSeries, plate: Plate, estimate: PoseEstimate) -> float:
    """Standard deviation of the ranges on the plate about its poses [m]."""
    rows = np.flatnonzero(estimate.valid)
    rows = rows[:: -(-len(rows) // _AT_ONCE)]
    scan = replace(scanner, ranges=series.ranges[rows].astype(float))
    cluster = extract_plate(scan, plate, estimate.pose[rows])
    full = np.flatnonzero(cluster.count >= _MIN_RETURNS)
    if not full.size:
        return scanner.noise
    beams = PlateBeams.of(scan, cluster.take(full))
    misfit = PlateLikelihood(plate, _NO_OUTLIER).misfit(beams, estimate.pose[rows][full])
    count = cluster.count[full]
    return float(np.median(misfit * np.sqrt(count / (count - 2)))) * beams.noise


def _rates(track: _Track, turned: Turned, time: Array) -> Array:
    """Velocities (S, 3) of the plate in the scanner's frame [m/s, m/s, rad/s]."""
    speed = (turned.at(time + _BESIDE) - turned.at(time - _BESIDE)) / (2 * _BESIDE)
    velocity = speed @ track.motion.matrix.T
    heading = np.where(track.estimate.valid, track.estimate.pose[:, 2], track.expected[:, 2])
    return np.column_stack([se2.rotate(heading, velocity[:, :2]), velocity[:, 2]])


def _bearing(series: ScanSeries, pose: Array) -> Array:
    """Bearings (S,) of plates at poses (S, 3), within the scanner's, which need not be centred on 0."""
    bearing = np.arctan2(pose[:, 1], pose[:, 0])
    return np.asarray(series.bearings[0] + (bearing - series.bearings[0]) % (2 * np.pi))


def _clusters(scan: Scan, plate: Plate, pose: Array, track: _Track) -> Cluster:
    """The returns of the plate in each scan; none where it is not known where the plate is."""
    parts = []
    for begin in range(0, len(pose), _AT_ONCE):
        rows = slice(begin, begin + _AT_ONCE)
        part = replace(scan, ranges=scan.ranges[rows].astype(float))
        parts.append(extract_plate(part, plate, pose[rows]))
    cluster = Cluster.joined(parts)
    lost = ~(track.near | track.estimate.valid)
    cluster.hit[lost], cluster.count[lost], cluster.lost[lost] = False, 0, 0
    return cluster


def _no_plate(scanner: Scan, series: ScanSeries, plate: Plate, estimate: PoseEstimate) -> LogError:
    """The error for a missing plate, with the objects that move instead."""
    scan = replace(scanner, ranges=series.ranges[:_AT_ONCE].astype(float))
    length = moving_things(scan, plate, estimate.pose[:_AT_ONCE], estimate.valid[:_AT_ONCE]).length
    seen = f"what moves is {length:.2g} m long" if np.isfinite(length) else "nothing moves"
    size = f"{plate.length:g}x{plate.thickness:g} m"
    return LogError(f"no plate of {size} moves as the encoders say in its {len(series.time)} scans: {seen}")
