"""Drives of a robot with a plate in front of a stationary scanner: encoders and scans in a bag."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from trackslip.errors import LogError, counted
from trackslip.kinematics import Array
from trackslip.localization.scan import Plate
from trackslip.logs.runlog import Refused, RunLog
from trackslip.rangefinder.align import Alignment, mounting
from trackslip.rangefinder.findings import findings
from trackslip.rangefinder.log import scanned_log
from trackslip.rangefinder.plate_motion import PlatePlace, Turned, plate_place
from trackslip.rangefinder.series import MIN_SCANS, ScanSeries
from trackslip.rangefinder.session import Sighting, sight_plate
from trackslip.ros.bag import Bag, read_each
from trackslip.ros.choice import BagChoice
from trackslip.ros.encoders import by_drive, read_encoders
from trackslip.ros.poses import read_poses
from trackslip.ros.scans import Scans, read_scans
from trackslip.ros.stamps import seconds
from trackslip.ros.transforms import fixed_in

_MAX_TILT = np.radians(20.0)  # of a scanner's axis to the vertical
_FEW = 0.02  # share of the scans before and after the encoders' readings that needs no line [-]
_OTHER_SCALE = 0.01, 3.0  # difference of scales that is worth a line [-], and in standard errors


@dataclass(frozen=True)
class Stand:
    """Pose of the scanner."""

    mount: Array  # (3,) in the frame of the poses [m, m, rad]
    source: str
    """Source of the scanner's pose."""
    upside_down: bool = False
    """True if it is mounted upside down."""
    aligned: Alignment | None = None
    """Its errors, where it follows from other poses."""


@dataclass(frozen=True)
class ScannedDrive:
    """A drive in view of a scanner."""

    log: RunLog
    """Poses are the plate's."""
    seen: Sighting
    stand: Stand
    place: PlatePlace | None
    """Place of the plate on the robot, as far as its motion shows."""
    taken: str
    """Topics taken from the bag, in words."""


def read_scanned(path: Path, choice: BagChoice) -> tuple[list[ScannedDrive], tuple[Refused, ...], tuple[str, ...]]:
    """The drives in a bag, or in all bags of a folder, the bags without any, and notes on what was left out.

    Raises LogError if there is no drive.
    """
    return read_each(path, lambda bag, name, notes: scanned_drives(bag, choice, notes, name), choice.max_expanded)


def scanned_drives(bag: Bag, choice: BagChoice, notes: list[str], name: str | None = None) -> list[ScannedDrive]:
    """The drives in a bag, one unless its clock restarts.

    `notes` gets a line for what is left out, and for what is doubtful. Raises LogError, naming topic and cause.
    """
    plate = choice.plate or Plate()
    encoders, every_scan = read_encoders(bag, choice, notes), read_scans(bag, choice.scan, notes)
    transformed = _stand(bag, every_scan[0], choice, notes)
    drives = []
    for part, turned, scans in by_drive(bag, name or bag.name, encoders, every_scan):
        origin = int(turned.stamp[0])
        time = seconds(turned.stamp, origin)
        series = _within(scans.series(part, origin), float(time[-1]), scans.source)
        if transformed.upside_down:
            series = series.mirrored()
        motion = Turned.of(time, turned.omega)
        try:
            seen = sight_plate(series, motion, plate, choice.noise)
        except LogError as error:
            raise LogError(f"{bag.path}: topic {scans.source}: {error}") from error
        notes += findings(seen, plate)
        stand = transformed if choice.poses is None else _aligned(bag, seen, choice.poses, origin, notes)
        valid = seen.estimate.valid
        place = plate_place(seen.time[valid], motion.at(seen.time[valid]), seen.estimate.pose[valid])
        about = {
            **turned.about,
            "scans": scans.source,
            "mount": stand.mount.tolist(),
            "mount_from": stand.source,
            "start": origin / 1e9,
        }
        log = scanned_log(part, time, turned.omega, seen, plate, stand.mount, {"bag": about})
        taken = f"{turned.taken}; poses: the plate's in {scans.source}; scanner: {stand.source}"
        drives.append(ScannedDrive(log, seen, stand, place, taken))
    return drives


def _within(series: ScanSeries, end: float, topic: str) -> ScanSeries:
    """The scans from 0 to `end` [s], while the encoders are read; LogError if there are hardly any."""
    rows = np.flatnonzero((series.time >= 0.0) & (series.time + series.lag.max() <= end))
    left_out = len(series.time) - len(rows)
    if len(rows) < MIN_SCANS:
        raise LogError(
            f"topic {topic}: {counted(len(rows), 'scan')} while the encoders are read, needs at least {MIN_SCANS}"
        )
    if left_out <= _FEW * len(series.time):
        return series.take(rows)
    return series.take(
        rows, f"topic {topic}: {counted(left_out, 'scan')} before and after the encoders' readings left out"
    )


def _stand(bag: Bag, scans: Scans, choice: BagChoice, notes: list[str]) -> Stand:
    """The scanner's pose by the choice or the transforms; without either it is the origin."""
    try:
        found = fixed_in(bag, scans.frame, notes) if scans.frame else None
    except LogError as error:
        what = f"topic {scans.source}: {error}: a scanner beside the field is needed, which stands still"
        raise LogError(what) from error
    own = Stand(np.zeros(3), "the scanner is the origin of the poses, and looks along x")
    if found is not None:
        frame, place, turn = found
        ahead, up = turn.as_matrix()[:, 0], turn.as_matrix()[2, 2]
        if abs(up) < np.cos(_MAX_TILT):
            notes.append(f"frame {scans.frame!r} is tilted by {np.degrees(np.arccos(abs(up))):.0f}° in {frame!r}")
        mount = np.array([place[0], place[1], np.arctan2(ahead[1], ahead[0])])
        own = Stand(mount, f"from transforms, in {frame}", bool(up < 0))
    return own if choice.mount is None else Stand(np.array(choice.mount, float), "as given", own.upside_down)


def _aligned(bag: Bag, seen: Sighting, source: str, origin: int, notes: list[str]) -> Stand:
    """The scanner's pose in the frame of other poses."""
    valid = seen.estimate.valid
    other = max(read_poses(bag, source, notes), key=lambda one: len(one.stamp))
    found = mounting(seen.time[valid], seen.estimate.pose[valid], seconds(other.stamp, origin), other.pose[:, :2])
    if abs(found.scale - 1) > max(_OTHER_SCALE[0], _OTHER_SCALE[1] * found.scale_stderr):
        times = f"{found.scale:.3f} ± {found.scale_stderr:.3f} times"
        notes.append(f"{source}: lengths are {times} those of the scanner: which of them is right?")
    return Stand(found.mount, f"from {source}", aligned=found)
