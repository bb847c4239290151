"""Drives of a robot with a plate before a scanner beside the field: encoders and scans in a bag."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from trackslip.errors import LogError
from trackslip.kinematics import Array
from trackslip.localization.scan import Plate
from trackslip.logs.runlog import Refused, RunLog, none_usable
from trackslip.rangefinder.align import Alignment, mounting
from trackslip.rangefinder.findings import findings
from trackslip.rangefinder.log import scanned_log
from trackslip.rangefinder.plate_motion import PlatePlace, Turned, plate_place
from trackslip.rangefinder.series import MIN_SCANS, ScanSeries
from trackslip.rangefinder.session import Sighting, sight_plate
from trackslip.ros.bag import Bag, open_bags
from trackslip.ros.choice import BagChoice
from trackslip.ros.encoders import Encoders, read_encoders
from trackslip.ros.poses import read_poses
from trackslip.ros.scans import Scans, read_scans
from trackslip.ros.stamps import require_overlap, seconds
from trackslip.ros.transforms import fixed_in

_MAX_TILT = np.radians(20.0)  # of a scanner's axis to the vertical
_FEW = 0.02  # share of the scans before and after the encoders' readings that needs no line [-]
_OTHER_SCALE = 0.01, 3.0  # difference of scales that is told [-], and in standard errors


@dataclass(frozen=True)
class Stand:
    """Where the scanner stands."""

    mount: Array  # (3,) in the frame of the poses [m, m, rad]
    source: str
    """How that is known."""
    upside_down: bool = False
    """Whether it looks at the field from below."""
    aligned: Alignment | None = None
    """Its errors, where it follows from other poses."""


@dataclass(frozen=True)
class ScannedDrive:
    """A drive before a scanner."""

    log: RunLog
    """Poses are the plate's."""
    seen: Sighting
    stand: Stand
    place: PlatePlace | None
    """Where the plate sits on the robot, as far as its motion tells."""

    @property
    def taken(self) -> str:
        """What was taken of the bag."""
        about = self.log.metadata["bag"]
        left, right = (", ".join(about[side]) for side in ("left", "right"))
        poses = f"poses: the plate's in {about['scans']}"
        return f"encoders: {about['encoders']}, left {left}, right {right}; {poses}; scanner: {self.stand.source}"


@dataclass(frozen=True)
class ScannedDrives:
    """The drives in bags, and what was left out."""

    drives: tuple[ScannedDrive, ...]
    refused: tuple[Refused, ...]
    """Bags that give none."""
    notes: tuple[str, ...]
    """What was left out, and what is doubtful, one line each."""


def read_scanned(path: Path, choice: BagChoice) -> ScannedDrives:
    """The drives in a bag, or in all bags of a folder; raises LogError if there is none."""
    bags = open_bags(path)
    drives: list[ScannedDrive] = []
    refused: list[Refused] = []
    notes: list[str] = []
    names = [bag.name for bag in bags]
    for bag in bags:
        name = bag.name if names.count(bag.name) == 1 else str(bag.files[0])
        said: list[str] = []
        try:
            drives += scanned_drives(bag, choice, said, name)
        except LogError as error:
            refused.append(Refused.of(name, error))
        said = [*bag.notes, *said]
        notes += said if len(bags) == 1 else [f"{name}: {line}" for line in said]
    if not drives:
        raise LogError(refused[0].reason if len(bags) == 1 else none_usable(refused))
    return ScannedDrives(tuple(drives), tuple(refused), tuple(notes))


def scanned_drives(bag: Bag, choice: BagChoice, notes: list[str], name: str | None = None) -> list[ScannedDrive]:
    """The drives in a bag, one unless its clock restarts.

    `notes` gets a line for what is left out, and for what is doubtful. Raises LogError, naming topic and cause.
    """
    plate = choice.plate or Plate()
    encoders, scans = read_encoders(bag, choice, notes), read_scans(bag, choice.scan, notes)
    stand = _stand(bag, scans[0], choice, notes)
    if len(encoders) != len(scans):
        raise LogError(
            f"{bag.path}: time goes back {len(encoders) - 1} time(s) in topic {encoders[0].topic} "
            f"and {len(scans) - 1} time(s) in {scans[0].topic}"
        )
    name = name or bag.name
    names = [name] if len(scans) == 1 else [f"{name}, part {k}" for k in range(1, len(scans) + 1)]
    return [
        _drive(bag, one, turned, seen, plate, stand, choice, notes)
        for one, turned, seen in zip(names, encoders, scans, strict=True)
    ]


def _drive(
    bag: Bag,
    name: str,
    encoders: Encoders,
    scans: Scans,
    plate: Plate,
    stand: Stand,
    choice: BagChoice,
    notes: list[str],
) -> ScannedDrive:
    require_overlap((encoders.topic, encoders.stamp), (scans.topic, scans.stamp))
    origin = int(encoders.stamp[0])
    time = seconds(encoders.stamp, origin)
    series = _within(scans.series(name, origin), float(time[0]), float(time[-1]), scans.topic)
    if stand.upside_down:
        series = series.mirrored()
    turned = Turned.of(time, encoders.omega)
    try:
        seen = sight_plate(series, turned, plate, choice.noise)
    except LogError as error:
        raise LogError(f"{bag.path}: topic {scans.topic}: {error}") from error
    notes += findings(seen, plate)
    if choice.poses is not None:
        stand = _aligned(bag, seen, choice.poses, origin, notes)
    valid = seen.estimate.valid
    place = plate_place(seen.time[valid], turned.at(seen.time[valid]), seen.estimate.pose[valid])
    about = {
        "encoders": encoders.topic,
        "left": list(encoders.joints[0]),
        "right": list(encoders.joints[1]),
        "scans": scans.topic,
        "mount": [float(value) for value in stand.mount],
        "mount_from": stand.source,
        "start": origin / 1e9,
    }
    log = scanned_log(name, time, encoders.omega, seen, plate, stand.mount, {"bag": about})
    return ScannedDrive(log, seen, stand, place)


def _within(series: ScanSeries, begin: float, end: float, topic: str) -> ScanSeries:
    """The scans while the encoders are read; LogError if there are hardly any."""
    rows = np.flatnonzero((series.time >= begin) & (series.time + series.lag.max() <= end))
    left_out = len(series.time) - len(rows)
    if len(rows) < MIN_SCANS:
        raise LogError(f"topic {topic}: {len(rows)} scan(s) while the encoders are read, needs at least {MIN_SCANS}")
    if left_out <= _FEW * len(series.time):
        return series.take(rows)
    return series.take(rows, f"topic {topic}: {left_out} scans before and after the encoders' readings are left out")


def _stand(bag: Bag, scans: Scans, choice: BagChoice, notes: list[str]) -> Stand:
    """Where the scanner stands, if the choice or the transforms tell; else it is the origin."""
    own = Stand(np.zeros(3), "the scanner is the origin of the poses, and looks along x")
    if not scans.frame:
        found = None
    else:
        try:
            found = fixed_in(bag, scans.frame, notes)
        except LogError as error:
            what = f"topic {scans.topic}: {error}: a scanner beside the field is needed, which stands still"
            raise LogError(what) from error
    upside_down = False
    if found is not None:
        frame, place, quaternion = found
        axes = Rotation.from_quat(quaternion).as_matrix()
        upside_down = bool(axes[2, 2] < 0)
        if abs(axes[2, 2]) < np.cos(_MAX_TILT):
            notes.append(
                f"frame {scans.frame!r} is tilted by {np.degrees(np.arccos(abs(axes[2, 2]))):.0f}° in {frame!r}"
            )
        own = Stand(
            np.array([place[0], place[1], np.arctan2(axes[1, 0], axes[0, 0])]),
            f"from transforms, in {frame}",
            upside_down,
        )
    if choice.mount is not None:
        return Stand(np.array(choice.mount, float), "as given", upside_down)
    return own


def _aligned(bag: Bag, seen: Sighting, source: str, origin: int, notes: list[str]) -> Stand:
    """Where the scanner stands in the frame of other poses."""
    valid = seen.estimate.valid
    others = read_poses(bag, source, notes)
    other = max(others, key=lambda one: len(one.stamp))
    found = mounting(seen.time[valid], seen.estimate.pose[valid], seconds(other.stamp, origin), other.pose[:, :2])
    off, errors = abs(found.scale - 1), found.scale_stderr
    if off > max(_OTHER_SCALE[0], _OTHER_SCALE[1] * errors):
        times = f"{found.scale:.3f} ± {errors:.3f} times"
        notes.append(f"{source}: lengths are {times} those of the scanner: which of them is right?")
    return Stand(found.mount, f"from {source}", aligned=found)
