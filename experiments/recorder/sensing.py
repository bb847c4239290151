"""Measurements of the robot: the scans, the plate found in them, and its covariance."""

import mujoco
import numpy as np
import rerun as rr

from experiments.common.colours import VERMILLION
from experiments.recorder.stream import Recording, about_vertical, at_height, paint, rgb
from experiments.recorder.traces import Traces
from trackslip.kinematics import Array
from trackslip.logs.scanlog import ScanLog

ESTIMATE_COLOUR, PLATE_COLOUR, OTHER_COLOUR = VERMILLION, "#ff3d7f", "#8d6bd1"
_MAGNIFIED = 30.0 * 3  # factor on standard deviations of positions, which are a fraction of a millimetre
_ON_TOP = 0.11  # top of the plate above its middle [m]
_MAX_RAYS = 24  # drawn per scan
_EVERY_OTHER = 4  # one return in so many is drawn of those that are not the plate's


def send_estimate(recording: Recording, entity: str, traces: Traces, model: mujoco.MjModel) -> None:
    """Send the plate and the magnified ellipse of its position covariance, in the rows in which it was found."""
    time, covariance, known = traces.time, traces.log.covariance, np.isfinite(traces.estimate).all(axis=1)
    if not known.any():
        return
    plate, pose, counts = model.geom("plate"), traces.estimate[known], known.astype(int)
    height = float(plate.pos[2])
    recording.poses(f"{entity}/plate", time[known], at_height(pose, height), about_vertical(pose[:, 2]))
    look = rr.Boxes3D.from_fields(**paint(ESTIMATE_COLOUR, 0.004))
    size = np.tile(plate.size * [1, 1, 1.05], (len(pose), 1))
    recording.shapes(f"{entity}/plate", time, counts, look, half_sizes=size)
    if covariance is None or not np.isfinite(covariance[known]).all():
        return
    variance, axes = np.linalg.eigh(covariance[known, :2, :2])
    ellipses: dict[str, Array] = {
        "half_sizes": at_height(_MAGNIFIED * np.sqrt(np.maximum(variance, 0)), 0.004),
        "centers": at_height(pose, height + _ON_TOP),
        "quaternions": about_vertical(np.arctan2(axes[:, 1, 0], axes[:, 0, 0])),
    }
    solid = rr.Ellipsoids3D.from_fields(colors=[(*rgb(ESTIMATE_COLOUR), 110)], fill_mode="solid")
    recording.shapes(f"{entity}/covariance", time, counts, solid, **ellipses)


def send_scans(recording: Recording, entity: str, traces: Traces, height: float) -> None:
    """Send the scans' returns, and rays to the plate; in rows where it wasn't found, no return is the plate's."""
    scans, time = traces.log.scans, traces.time
    if scans is None:
        return
    origin, heading = np.append(scans.scan.mount[:2], height), float(scans.scan.mount[2])
    cluster = scans.cluster
    hit = cluster.hit & traces.log.is_valid[:, None]
    plate = _points(origin, heading, cluster.bearing, np.where(hit, cluster.range, np.nan))
    others = _others(scans, hit, origin, heading)
    for name, points, colour in (("plate", plate, PLATE_COLOUR), ("other", others, OTHER_COLOUR)):
        known, look = np.isfinite(points[..., 0]), rr.Points3D.from_fields(**paint(colour, 0.012))
        recording.shapes(f"{entity}/{name}", time, known.sum(axis=1), look, positions=points[known])
    step = np.maximum(1, cluster.count // _MAX_RAYS)[:, None]
    ray = hit & (np.cumsum(hit, axis=1) % step == 0)
    strips = np.stack([np.broadcast_to(origin, plate[ray].shape), plate[ray]], axis=1)
    line = rr.LineStrips3D.from_fields(**paint(PLATE_COLOUR, 0.0015, 60))
    recording.shapes(f"{entity}/rays", time, ray.sum(axis=1), line, strips=strips)


def _points(origin: Array, heading: float, bearing: Array, distance: Array) -> Array:
    """The end points (..., 3) of beams."""
    angle = heading + bearing
    x, y = origin[0] + distance * np.cos(angle), origin[1] + distance * np.sin(angle)
    return np.stack([x, y, np.full_like(x, origin[2])], axis=-1)


def _others(scans: ScanLog, hit: np.ndarray, origin: Array, heading: float) -> Array:
    """Some of the returns (T, B', 3) other than the plate's, which `hit` (T, W) marks in the cluster; NaN elsewhere."""
    if scans.full is None:
        return np.empty((len(scans.cluster.count), 0, 3))
    rest = scans.full.copy()
    rows, columns = np.nonzero(hit)
    rest[rows, scans.first_beam()[rows] + columns] = np.nan
    return _points(origin, heading, scans.scan.bearings, rest)[:, ::_EVERY_OTHER]
