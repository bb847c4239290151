"""Quantities over time, derived from a run's log."""

import contextlib
from pathlib import Path

import numpy as np
import scipy

from experiments.common.lookup import reference as load_reference
from trackslip import se2
from trackslip.errors import TrackslipError
from trackslip.kinematics import Array, RobotGeometry, curvature, track_slip
from trackslip.logs.runlog import MALFORMED, RunLog, stored_geometry
from trackslip.metrics import TRANSIENT, body_errors
from trackslip.motion.filtered import even_poses
from trackslip.slip.law_file import SHIPPED, load_laws
from trackslip.trajectory.base import Reference
from trackslip.trajectory.segmented import circle

_MIN_SPROCKET_SPEED = 0.3  # below it a slip is a quotient of noise [rad/s]
_POLE = 0.5  # slip beyond which a law is near its pole [-]
_BELOW_TOP = 1 - 1e-9  # factor on the top speed: slower set points were not scaled down to it
_DEGREE = 4  # of the polynomials that smooth poses, after Savitzky and Golay
_MAX_WINDOW = 3.0  # that a polynomial is fitted to [s]
_MAX_TURN = 0.5  # within a window, so that the polynomials follow the circle [rad]
_BY_DEFAULT = "icr_radius"  # law shown for a run without compensation


class Traces:
    """A run of T rows, ready to be drawn. What a log doesn't have is None; what it lacks in a row is NaN."""

    def __init__(self, log: RunLog, laws: Path | None = None) -> None:
        """`laws` is a file or folder of identified laws, by default the shipped one."""
        self.log, truth = log, log.truth
        self.time = log.time - log.time[0]  # (T,) [s]
        self.estimate = np.where(log.is_valid[:, None], log.pose, np.nan)
        """Measured poses (T, 3), NaN where there is none."""
        self.pose = _filled(self.estimate) if truth is None else truth.pose
        """True poses (T, 3), or the last ones measured if there is no truth."""
        path = reference_of(log)
        self.reference = None if path is None else path.pose(log.time)
        """Desired poses (T, 3)."""
        self.error = None if self.reference is None else body_errors(self.pose, self.reference)
        """Pose errors (T, 3) in the body frame [m, m, rad]."""
        self.slip: Array | None = None
        """True slips (T, 2) [-]."""
        self.identified: Array | None = None
        """Slips (T, 2) from the smoothed measured poses [-]."""
        self.law: Array | None = None
        """Slips (T, 2) by a law, at the commanded curvature, else at the one driven [-]."""
        self.law_name = ""
        if (geometry := stored_geometry(log)) is not None:
            driven = _smooth_twist(log)
            self.identified = None if driven is None else _slip(log.omega, driven, geometry)
            if truth is not None:
                twist = truth.twist[:, [0, 2]]
                driven = (twist + np.concatenate([twist[:1], twist[:-1]])) / 2
                self.slip = _slip(log.omega, driven, geometry)
            self.law, self.law_name = _slip_by_law(log, geometry, driven, laws)

    @property
    def distance(self) -> Array | None:
        """(T,) distance from the desired position [m]."""
        return None if self.error is None else np.hypot(self.error[:, 0], self.error[:, 1])

    @property
    def moment(self) -> float:
        """The moment of interest: the largest error after the transient, else the middle of the run [s]."""
        late = self.time >= TRANSIENT
        if self.distance is None or not late.any():
            return float(self.time[len(self.time) // 2])
        return float(self.time[np.argmax(np.where(late, self.distance, 0.0))])

    @property
    def mount(self) -> Array | None:
        """(3,) pose of the scanner, if the log has it."""
        if self.log.scans is not None:
            return self.log.scans.scan.mount
        with contextlib.suppress(*MALFORMED):
            mount = np.array(self.log.metadata["lrf"]["mount"], float)
            return mount if mount.shape == (3,) and np.isfinite(mount).all() else None
        return None


def reference_of(log: RunLog) -> Reference | None:
    """The reference of a run, if the log names it and it still exists."""
    name, arc = log.metadata.get("reference"), log.metadata.get("circle")
    with contextlib.suppress(*MALFORMED):
        return circle(**arc) if arc else load_reference(str(name))
    return None


def _slip(omega: Array, twist: Array, geometry: RobotGeometry) -> Array:
    """Slips (T, 2), NaN where a sprocket hardly turns."""
    return np.where(np.abs(omega) > _MIN_SPROCKET_SPEED, track_slip(omega, twist, geometry), np.nan)


def _smooth_twist(log: RunLog) -> Array | None:
    """Mean twists (T, 2) since the row before, by polynomials fitted to a sliding window of measured poses.

    NaN beyond the poses; None if there are too few.
    """
    try:
        time, pose = even_poses(log)
    except TrackslipError:
        return None
    step = float(time[1] - time[0])
    rate = abs(pose[-1, 2] - pose[0, 2]) / (time[-1] - time[0])
    rows = int(min(_MAX_WINDOW, _MAX_TURN / max(rate, 1e-9)) / step)
    window = int(np.clip(rows, _DEGREE + 3, len(time) - 1)) // 2 * 2 - 1
    filtered = [scipy.signal.savgol_filter(pose, window, _DEGREE, deriv=k, delta=step, axis=0) for k in (0, 1)]
    heading, rates = filtered[0][:, 2], filtered[1]
    v = se2.rotate(-heading, rates[:, :2])[:, 0]
    middle = log.time - np.diff(log.time, prepend=log.time[0]) / 2  # measured sprocket speeds are means, too
    return np.stack([np.interp(middle, time, column, np.nan, np.nan) for column in (v, rates[:, 2])], axis=-1)


def _slip_by_law(
    log: RunLog, geometry: RobotGeometry, driven: Array | None, file: Path | None
) -> tuple[Array | None, str]:
    """Slips (T, 2) that the run's compensation assumed, or the shown law's along the drive, and the law's name.

    Compensation's slips are those between commanded twists and set points that the top speed didn't limit.
    """
    name = str(log.metadata.get("compensation", "none"))
    if name != "none" and log.command is not None and log.twist_command is not None:
        fastest = np.inf
        with contextlib.suppress(*MALFORMED):
            fastest = float(log.metadata["drive"]["top_speed"]) or np.inf
        limit = _BELOW_TOP * fastest / geometry.sprocket_radius
        slip = track_slip(log.command, log.twist_command, geometry)
        slip = np.where(np.abs(log.command).max(axis=1, keepdims=True) < limit, slip, np.nan)
    else:
        law, name = None, _BY_DEFAULT
        for source in (file or SHIPPED, SHIPPED):  # a folder of results may have no laws
            with contextlib.suppress(TrackslipError):
                law = law or load_laws(source, geometry).get(name)
        twist = driven if log.twist_command is None else log.twist_command
        if law is None or twist is None:
            return None, ""
        slip = law(curvature(twist))
    return np.where((np.abs(slip) < _POLE) & (np.abs(log.omega) > _MIN_SPROCKET_SPEED), slip, np.nan), name


def _filled(pose: Array) -> Array:
    """Poses (T, 3) with NaN replaced by the last known pose, or at the start by the first."""
    known = np.isfinite(pose).all(axis=1)
    if not known.any():
        return np.zeros_like(pose)
    last = np.maximum.accumulate(np.where(known, np.arange(len(pose)), -1))
    return pose[np.where(last < 0, np.argmax(known), last)]
