"""Measurements in a recording: the scans, and the plate that was detected in them."""

from typing import Final

import mujoco
import numpy as np
import rerun as rr

from experiments.common.colours import VERMILLION
from experiments.common.traces import Traces
from experiments.recorder.stream import Recording, about_vertical, at_height, paint
from trackslip.kinematics import Array

ESTIMATE_COLOUR: Final = VERMILLION
PLATE_COLOUR: Final = "#ff3d7f"
OTHER_COLOUR: Final = "#8d6bd1"
_EVERY: Final = 4  # every n-th return is drawn, but all returns from the plate


def send_estimate(recording: Recording, entity: str, traces: Traces, model: mujoco.MjModel) -> None:
    """Send the estimated plate, in the rows in which it was detected."""
    known = np.isfinite(traces.estimate).all(axis=1)
    plate = model.geom("plate")
    pose = traces.estimate[known]
    size = plate.size * [1, 1, 1.05]  # a little higher than the true plate, to be seen
    look = rr.Boxes3D.from_fields(half_sizes=[size], **paint(ESTIMATE_COLOUR, 0.004))
    centres = at_height(pose, float(plate.pos[2]))
    turns = about_vertical(pose[:, 2])
    counts = known.astype(int)
    recording.shapes(
        f"{entity}/plate", traces.time, counts, look, centers=centres, quaternions=turns
    )


def send_scans(recording: Recording, entity: str, traces: Traces, height: float) -> None:
    """Send the scans' returns and, in the rows in which the plate was detected, the beams to the
    plate.
    """
    scans = traces.log.scans
    time = traces.time
    if scans is None:
        return
    mount = scans.scan.mount
    cluster = scans.cluster
    count = np.where(traces.log.is_valid, cluster.count, 0)
    hit = traces.log.is_valid[cluster.row]
    plate = _points(mount, height, cluster.bearing[hit], cluster.range[hit])
    dots = rr.Points3D.from_fields(**paint(PLATE_COLOUR, 0.012))
    recording.shapes(f"{entity}/plate", time, count, dots, positions=plate)

    scanner = np.broadcast_to([*mount[:2], height], plate.shape)
    beams = np.stack([scanner, plate], axis=1)
    line = rr.LineStrips3D.from_fields(**paint(PLATE_COLOUR, 0.0015, 60))
    recording.shapes(f"{entity}/beams", time, count, line, strips=beams)

    if scans.full is None:
        return
    ranges = scans.full.copy()
    ranges[cluster.row[hit], scans.beam[hit]] = np.nan
    ranges = ranges[:, ::_EVERY]
    bearings = scans.scan.bearings[::_EVERY]
    known = np.isfinite(ranges)
    dots = rr.Points3D.from_fields(**paint(OTHER_COLOUR, 0.012))
    others = _points(mount, height, bearings, ranges)[known]
    recording.shapes(f"{entity}/other", time, known.sum(axis=1), dots, positions=others)


def _points(mount: Array, height: float, bearing: Array, distance: Array) -> Array:
    """End points (..., 3) [m] of beams from a scanner at `mount` (3,) [m, m, rad]."""
    angle = mount[2] + bearing
    x = mount[0] + distance * np.cos(angle)
    y = mount[1] + distance * np.sin(angle)
    return np.stack([x, y, np.full_like(x, height)], axis=-1)
