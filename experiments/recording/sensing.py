"""Measurements of the robot: the scans, the plate found in them, and its covariance."""

import mujoco
import numpy as np
import rerun as rr

from experiments.recording.columns import at_height, quaternion, rgb, send, send_poses
from experiments.recording.traces import Traces
from experiments.report.colours import VERMILLION
from trackslip.kinematics import Array
from trackslip.logs.scanlog import ScanLog

ESTIMATE_COLOUR, PLATE_COLOUR, OTHER_COLOUR = VERMILLION, "#ff3d7f", "#8d6bd1"
MAGNIFIED = 30.0  # magnification of the 3-sigma ellipses of covariance, which are millimetres in size
_SIGMAS = 3.0
_ON_TOP = 0.11  # top of the plate above its middle [m]
_MAX_RAYS = 24  # drawn per scan
_EVERY_OTHER = 4  # one return in so many is drawn of those that are not the plate's


def send_estimate(stream: rr.RecordingStream, entity: str, traces: Traces, model: mujoco.MjModel) -> None:
    """Send the plate and the magnified ellipse of its position covariance, in the rows in which it was found."""
    log = traces.log
    known = np.isfinite(traces.estimate).all(axis=1)
    if not known.any():
        return
    plate, found = model.geom("plate"), traces.estimate[known]
    height = float(plate.pos[2])
    plate_found = f"{entity}/estimate/plate"
    stream.log(plate_found, rr.Boxes3D.from_fields(colors=[rgb(ESTIMATE_COLOUR)], radii=[0.004]), static=True)
    send_poses(stream, plate_found, traces.time[known], found, height)
    size = np.tile(plate.size * [1, 1, 1.05], (len(found), 1))
    send(stream, plate_found, traces.time, rr.Boxes3D.columns(half_sizes=size).partition(known.astype(int)))
    if log.covariance is None or not np.isfinite(log.covariance[known]).all():
        return
    variance, axes = np.linalg.eigh(log.covariance[known, :2, :2])
    half = MAGNIFIED * _SIGMAS * np.sqrt(np.maximum(variance, 0))
    ellipse = f"{entity}/estimate/covariance"
    style = rr.Ellipsoids3D.from_fields(colors=[(*rgb(ESTIMATE_COLOUR), 110)], fill_mode="solid")
    stream.log(ellipse, style, static=True)
    columns = rr.Ellipsoids3D.columns(
        half_sizes=np.column_stack([half, np.full(len(half), 0.004)]),
        centers=at_height(found, height + _ON_TOP),
        quaternions=quaternion(np.arctan2(axes[:, 1, 0], axes[:, 0, 0])),
    )
    send(stream, ellipse, traces.time, columns.partition(known.astype(int)))


def send_scans(stream: rr.RecordingStream, entity: str, traces: Traces, height: float) -> None:
    """Send the scans' returns, and rays to the plate; in rows where it wasn't found, no return is the plate's."""
    scans = traces.log.scans
    if scans is None:
        return
    origin, heading = np.append(scans.scan.mount[:2], height), float(scans.scan.mount[2])
    cluster = scans.cluster
    hit = cluster.hit & traces.log.is_valid[:, None]
    plate = _points(origin, heading, cluster.bearing, np.where(hit, cluster.range, np.nan))
    _send_points(stream, f"{entity}/scan/plate", traces.time, plate, PLATE_COLOUR)
    _send_points(stream, f"{entity}/scan/other", traces.time, _others(scans, hit, origin, heading), OTHER_COLOUR)
    step = np.maximum(1, cluster.count // _MAX_RAYS)[:, None]
    ray = hit & (np.cumsum(hit, axis=1) % step == 0)
    strips = np.stack([np.broadcast_to(origin, plate[ray].shape), plate[ray]], axis=1)
    rays = f"{entity}/scan/rays"
    style = rr.LineStrips3D.from_fields(colors=[(*rgb(PLATE_COLOUR), 60)], radii=[0.0015])
    stream.log(rays, style, static=True)
    if len(strips):
        send(stream, rays, traces.time, rr.LineStrips3D.columns(strips=strips).partition(ray.sum(axis=1)))


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


def _send_points(stream: rr.RecordingStream, entity: str, time: Array, points: Array, colour: str) -> None:
    known = np.isfinite(points[..., 0])
    if known.any():
        stream.log(entity, rr.Points3D.from_fields(colors=[rgb(colour)], radii=[0.012]), static=True)
        columns = rr.Points3D.columns(positions=points[known])
        send(stream, entity, time, columns.partition(known.sum(axis=1)))
