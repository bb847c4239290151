"""Starting values of fits to drives: of the clock offset, of the turns, of the trajectory, and of other laws."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from trackslip import se2
from trackslip.doubts import refuse
from trackslip.errors import LogError
from trackslip.identification.drive_fit import TrajectoryFit
from trackslip.identification.drives import PreparedDrive, reckoned
from trackslip.identification.solver import least_squares
from trackslip.kinematics import Array, RobotGeometry, body_twist, track_speeds
from trackslip.slip.families import FAMILIES

_OFFSETS = np.arange(-2.0, 2.0001, 0.05)  # clock offsets tried [s]
_FINE = np.arange(-0.06, 0.0601, 0.01)  # around the best of them [s]
_NEARLY, _APART, _MOST = 1.1, 0.3, 3  # clock offsets to start from: cost of the worst [-], distance [s], number
_TURN_RATIOS = 1 / (1 + np.concatenate([np.arange(-0.3, 1.61, 0.1), np.arange(1.8, 3.01, 0.2)]))  # b / (b + D)
_TURN_TIME = 1.0  # over which turns are compared [s]
_WINDOW = 10.0  # of paths that are laid over each other, without headings [s]
_CAP = 3.0  # deviations beyond which turns count no further [median deviations]
_RATIO_LIMITS = (0.2, 2.0)
_Tried = tuple[float, float, float]  # cost, ratio of turns, clock offset [s]
_EXPLAINED = 0.7  # share of the cost that turns to the wrong side leave, below which they are believed
_PIECE = 0.5  # time over which motion is averaged [s]
_MAX_PIECES = 600


def starts(drives: Sequence[PreparedDrive], geometry: RobotGeometry) -> list[tuple[float, float]]:
    """Offsets D of a constant ICR [m] and clock offsets [s] that fit the drives well, the best first.

    Raises LogError if the robot clearly turns against its sprockets.
    """
    costs = _turning_costs if all(drive.has_heading for drive in drives) else _path_costs

    coarse = costs(drives, geometry, _OFFSETS)
    against = min((cost for cost, ratio, _ in coarse if ratio < 0), default=np.inf)
    if against < _EXPLAINED * min(cost for cost, ratio, _ in coarse if ratio >= 0):
        refuse("against", drives[0].accept)
    if costs is _turning_costs:
        _require_both_forwards(drives, geometry, min(coarse)[0])
    by_offset: dict[float, _Tried] = {}
    for one in coarse:
        if one[1] > 0:
            by_offset[one[2]] = min(one, by_offset.get(one[2], one))
    turning = sorted(by_offset.values())
    least, found = turning[0][0] if turning else 0.0, list[tuple[float, float]]()
    for cost, _, offset in turning:
        if cost <= _NEARLY * least + 1e-12 and all(abs(offset - other) > _APART for _, other in found):
            fine = [one for one in costs(drives, geometry, offset + _FINE) if one[1] > 0]
            found.append(min(fine, default=(0.0, 1.0, offset))[1:3])
    return [
        (geometry.half_gauge * (1 / float(np.clip(ratio, *_RATIO_LIMITS)) - 1), offset)
        for ratio, offset in found[:_MOST] or [(1.0, 0.0)]
    ]


def gyro_clock(drives: Sequence[PreparedDrive], geometry: RobotGeometry, clock_offset: float) -> float:
    """Gyro's clock minus pose clock [s] at which it fits the headings best; without any, `clock_offset`."""
    turning = []
    for drive in drives:
        if drive.gyro is not None and drive.has_heading:
            rate = np.diff(drive.gyro[:, 1]) / np.diff(drive.gyro[:, 0])
            sides = rate[:, None] * [-1, 1] * geometry.half_gauge / geometry.sprocket_radius
            turning.append(replace(drive, edges=drive.gyro[:, 0], omega=sides))
    if not turning:
        return clock_offset
    coarse = min(_turning_costs(turning, geometry, _OFFSETS))[2]
    return min(_turning_costs(turning, geometry, coarse + _FINE))[2]


def _require_both_forwards(drives: Sequence[PreparedDrive], geometry: RobotGeometry, cost: float) -> None:
    """Raise LogError if turns are explained much better, than with `cost`, by an encoder that counts backwards."""
    mirrored = [replace(drive, omega=drive.omega * [-1, 1]) for drive in drives]
    least, ratio, _ = min(_turning_costs(mirrored, geometry, _OFFSETS[::2]), key=lambda one: one[0])
    if least < _EXPLAINED * cost and 0.1 < abs(ratio) < 10:
        refuse("mirrored", drives[0].accept, side="left" if ratio > 0 else "right")


def trajectory(drive: PreparedDrive, geometry: RobotGeometry, offset: float, clock_offset: float) -> Array:
    """States (K, 3) of a drive's nodes: measured, else dead reckoned with D = `offset` [m]."""
    ratio = geometry.half_gauge / (geometry.half_gauge + offset)
    place, heading = reckoned(drive, geometry, ratio, drive.time + clock_offset)
    measured = np.isfinite(drive.pose[:, 0])
    z = drive.pose[:, 0] + 1j * drive.pose[:, 1]
    if drive.has_heading:
        known = np.isfinite(drive.pose[:, 2])
        turned = np.unwrap(drive.pose[known, 2] - heading[known])
        turned = np.interp(drive.time, drive.time[known], turned)
    else:
        turned = _turned_to(place, np.where(measured, z, 0), measured, drive.time)
    last = np.maximum.accumulate(np.where(measured, np.arange(len(z)), -1))
    last = np.where(last < 0, int(np.argmax(measured)), last)
    at = np.where(measured, z, z[last] + np.exp(1j * turned[last]) * (place - place[last]))
    return np.column_stack([at.real, at.imag, heading + turned])


def _turning_costs(drives: Sequence[PreparedDrive], geometry: RobotGeometry, offsets: Array) -> list[_Tried]:
    """At clock offsets (n,), the ratio of measured to commanded turns, and 0, with the costs that they leave."""
    parts = zip(*(_turns(drive, geometry, offsets) for drive in drives), strict=True)
    real, commanded = (np.concatenate(part, axis=-1) for part in parts)
    if not len(real):
        return [(0.0, 1.0, offset) for offset in offsets.tolist()]
    ratio, weight = np.zeros(len(offsets)), np.ones(commanded.shape, bool)
    for _ in range(4):  # a few times, because turns across a jump must not count
        power = np.sum(weight * commanded**2, axis=1)
        shared = np.sum(weight * real * commanded, axis=1)
        ratio = np.divide(shared, power, out=np.ones_like(power), where=power > 0)
        deviation = np.abs(real - ratio[:, None] * commanded)
        weight = deviation <= _CAP * 1.4826 * np.median(deviation, axis=1, keepdims=True)
    ratios = np.stack([ratio, np.zeros_like(ratio)], axis=-1)
    left = np.stack([np.minimum(np.abs(real - one[:, None] * commanded), 0.2).mean(axis=1) for one in ratios.T], -1)
    at = np.repeat(offsets, 2)
    return list(zip(left.ravel().tolist(), ratios.ravel().tolist(), at.tolist(), strict=True))


def _path_costs(drives: Sequence[PreparedDrive], geometry: RobotGeometry, offsets: Array) -> list[_Tried]:
    """Ratios of turns, to the commanded side and, negative, to the other one, with the costs that they leave."""
    found = []
    for offset in offsets.tolist():
        for ratio in _TURN_RATIOS.tolist():
            same, other = np.sum([_misfits(drive, geometry, offset, ratio) for drive in drives], axis=0).tolist()
            found += [(same, ratio, offset), (other, -ratio, offset)]
    return found


def _turns(drive: PreparedDrive, geometry: RobotGeometry, offsets: Array) -> tuple[Array, Array]:
    """Measured (K,) and commanded turns (n, K) between poses about _TURN_TIME apart, at n clock offsets [rad]."""
    known = np.flatnonzero(np.isfinite(drive.pose[:, 2]))
    time, phi = drive.time[known], drive.pose[known, 2]
    stride = min(max(1, round(_TURN_TIME / drive.interval)), max(1, len(time) - 1))
    yaw_rate = body_twist(drive.omega, 0.0, geometry)[:, 1]
    turned = np.concatenate([[0.0], np.cumsum(yaw_rate * np.diff(drive.edges))])
    heading = np.interp(time + offsets[:, None], drive.edges, turned)
    near = time[stride:] - time[:-stride] < 3 * _TURN_TIME + 3 * drive.interval
    return (phi[stride:] - phi[:-stride])[near], (heading[:, stride:] - heading[:, :-stride])[:, near]


def _misfits(drive: PreparedDrive, geometry: RobotGeometry, offset: float, ratio: float) -> tuple[float, float]:
    """Median distances of windows of dead reckoning, and of their mirror images, laid over measured positions [m]."""
    measured = np.flatnonzero(np.isfinite(drive.pose[:, 0]))
    time = drive.time[measured]
    place, _ = reckoned(drive, geometry, ratio, time + offset)
    z = drive.pose[measured, 0] + 1j * drive.pose[measured, 1]
    size = min(max(6, round(_WINDOW / drive.interval)), len(z))
    firsts = np.arange(0, len(z) - size + 1, max(1, size // 2))
    rows = firsts[:, None] + np.arange(size)
    if not len(rows):
        raise LogError(f"run {drive.name!r}: too few poses")
    a, c = (values[rows] - values[rows].mean(axis=1, keepdims=True) for values in (z, place))
    both = np.sum(np.abs(a) ** 2 + np.abs(c) ** 2, axis=1)
    squares = [both - 2 * np.abs(np.sum(a * turned, axis=1)) for turned in (c.conj(), c)]
    same, other = np.median(np.sqrt(np.maximum(squares, 0) / size), axis=1).tolist()
    return same, other


def _turned_to(place: np.ndarray, z: np.ndarray, measured: np.ndarray, time: Array) -> Array:
    """Angles (K,) that turn dead reckoning onto the positions within a window around each node."""
    columns = np.stack([measured, measured * z, measured * place, measured * z * place.conj()])
    sums = np.concatenate([np.zeros((4, 1)), np.cumsum(columns, axis=1)], axis=1)
    low = np.searchsorted(time, time - _WINDOW / 2)
    high = np.searchsorted(time, time + _WINDOW / 2, side="right")
    number, a, c, product = sums[:, high] - sums[:, low]
    return np.unwrap(np.angle(product - a * c.conj() / np.maximum(number.real, 1)))


def law_start(name: str, reference: TrajectoryFit) -> Array:
    """Values (p,) of a law that fit the mean twists of pieces of the reference's trajectory in least squares.

    A law that contains the reference starts from its values, as least squares follow the few pieces that no law fits.
    """
    model, family = reference.model, FAMILIES[name]
    if not family.names:
        return np.zeros(0)
    geometry = model.geometry
    starts = family.starts(geometry.half_gauge)
    if set(model.family.names) <= set(family.names):
        known = dict(zip(model.names, reference.values.tolist(), strict=True))
        return np.array([known.get(key, value) for key, value in zip(family.names, starts[0].tolist(), strict=True)])
    omega, twist = pieces(reference)
    low, high, scale = family.limits(geometry.half_gauge)
    measured = track_speeds(twist, geometry.half_gauge)

    def residual(values: Array, rows: np.ndarray) -> Array:
        del rows
        found = track_speeds(family.law(values[:, None, :], geometry).twist(omega, geometry), geometry.half_gauge)
        return (found - measured).reshape(len(values), -1)

    reached = least_squares(residual, starts, low, high, scale)
    return reached.values[int(reached.cost.argmin())]


def pieces(fit: TrajectoryFit) -> tuple[Array, Array]:
    """Mean sprocket speeds (n, 2) [rad/s] and twists (n, 2) of the robot in pieces of about half a second."""
    model, values = fit.model, fit.values
    lever = values[[model.index("sensor_x"), model.index("sensor_y")]]
    offset = values[model.index("clock_offset")]
    found = []
    for drive, begin in zip(fit.nodes.drives, fit.nodes.first, strict=False):
        stride = max(1, round(_PIECE / drive.interval), len(drive.time) * len(fit.nodes.drives) // _MAX_PIECES)
        rows = np.arange(0, len(drive.time), stride)
        broken = np.concatenate([[0.0], np.cumsum(fit.nodes.link[begin : begin + len(drive.time) - 1] == 0)])
        state, step = fit.states[begin + rows], np.diff(drive.time[rows])
        robot = np.column_stack([se2.to_world(state, -lever), state[:, 2]])
        twist = se2.log(se2.steps(robot))[:, ::2] / step[:, None]
        turned = _turned(drive, drive.time[rows] + offset)
        whole = (np.diff(broken[rows]) == 0) & (step < 3 * _PIECE + 3 * drive.interval)
        found.append((np.diff(turned, axis=0) / step[:, None], twist, whole))
    omega, twist, whole = (np.concatenate(part) for part in zip(*found, strict=True))
    whole &= np.abs(omega).max(axis=1) > 0
    return omega[whole], twist[whole]


def _turned(drive: PreparedDrive, time: Array) -> Array:
    """Angles (K, 2) of the sprockets at encoder times [rad]."""
    angle = np.concatenate([np.zeros((1, 2)), np.cumsum(drive.omega * np.diff(drive.edges)[:, None], axis=0)])
    return np.column_stack([np.interp(time, drive.edges, angle[:, side]) for side in range(2)])
