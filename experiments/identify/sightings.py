"""Errors of localization along and across the line of sight, with their Cramér-Rao bound."""

import contextlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from typing import Any

import numpy as np

from sim.scanner.scanner import LaserScanner
from trackslip.kinematics import Array, wrap_angle
from trackslip.localization.bound import MIN_ANGLE, pose_bound, viewing_angle
from trackslip.localization.scan import Plate, Scan
from trackslip.logs.runlog import MALFORMED, RunLog
from trackslip.metrics import rms

_MAX_POSES = 5000  # poses that are evaluated


@dataclass(frozen=True)
class Sightings:
    """Poses of the plate seen by one scanner, rotated so that the first axis is the line of sight."""

    angle: Array  # (n,) between plate and line of sight, 0 to pi/2 [rad]
    error: Array  # (n, 3) along and across the line of sight [m], heading [rad]; NaN where nothing was measured
    bound: Array  # (n, 3) smallest possible standard deviations; NaN where unbounded

    @property
    def measured(self) -> np.ndarray:
        """Mask (n,) of the measured poses."""
        return np.asarray(np.isfinite(self.error).all(axis=1))

    def ratio(self) -> Array:
        """Errors (3,) over the bound, rms, at the angles where the bound is meaningful; NaN without poses there [-]."""
        clear = self.measured & np.isfinite(self.bound).all(axis=1) & (self.angle > MIN_ANGLE)
        if not clear.any():
            return np.full(3, np.nan)
        return np.array([rms(self.error[clear, k]) / rms(self.bound[clear, k]) for k in range(3)])


def sightings(logs: Sequence[RunLog]) -> Sightings | None:
    """About _MAX_POSES poses of the runs whose truth, plate, scanner and mount are known; None without any."""
    known = [(log, seen) for log in logs if log.truth is not None and (seen := _seen_by(log.metadata)) is not None]
    if not known:
        return None
    step = max(1, sum(len(log.time) for log, _ in known) // _MAX_POSES)
    return Sightings(*map(np.concatenate, zip(*(_of(log, *seen, step) for log, seen in known), strict=True)))


def _seen_by(metadata: Mapping[str, Any]) -> tuple[Plate, Scan] | None:
    """The plate, and a scan without ranges of the scanner that saw it; None without them or noise."""
    if "source" in metadata:  # of poses, as teleoperated drives have
        return None
    known = {field.name for field in fields(LaserScanner)}  # others are an older version's
    with contextlib.suppress(*MALFORMED):
        device = LaserScanner(**{name: value for name, value in metadata["scanner"].items() if name in known})
        mount = np.array(metadata["lrf"]["mount"], float)
        if device.noise > 0.0 and mount.shape == (3,) and np.isfinite(mount).all():  # without noise there is no bound
            scan = Scan(device.bearings, np.empty((0, device.bearings.size)), device.noise, mount)
            return Plate(**metadata["plate"]), scan
    return None


def _of(log: RunLog, plate: Plate, scan: Scan, step: int) -> tuple[Array, Array, Array]:
    """Angle, error and bound, as in Sightings, of every `step`-th pose of a run."""
    assert log.truth is not None
    true = scan.from_world(log.truth.pose[::step])
    estimated = scan.from_world(log.pose[::step])
    sight = np.arctan2(true[:, 1], true[:, 0])
    turn = _turned(-sight)
    error = np.einsum("nij,nj->ni", turn, estimated - true)
    error[:, 2] = wrap_angle(error[:, 2])
    error[~log.is_valid[::step]] = np.nan
    bound = turn @ pose_bound(true, plate, scan.bearings, scan.noise) @ turn.swapaxes(1, 2)
    return viewing_angle(true), error, np.sqrt(np.einsum("nii->ni", bound))


def _turned(angle: Array) -> Array:
    """Matrices (n, 3, 3) that rotate the first two of (x, y, phi) by angles (n,) [rad]."""
    cos, sin, nil, one = np.cos(angle), np.sin(angle), np.zeros_like(angle), np.ones_like(angle)
    return np.stack([cos, -sin, nil, sin, cos, nil, nil, nil, one], axis=-1).reshape(-1, 3, 3)
