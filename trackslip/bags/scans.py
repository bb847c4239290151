"""Runs of a robot with a plate in front of a stationary laser range finder: encoders and scans in a bag."""

from __future__ import annotations

from collections import defaultdict
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from trackslip.bags.open import Bag, Topic
from trackslip.bags.stamps import seconds, stretches
from trackslip.bags.transforms import links_of, read_transforms
from trackslip.errors import LogError, counted
from trackslip.kinematics import Array
from trackslip.localization.raw_scans import FollowedPlate, RawScans, follow_plate
from trackslip.localization.scan import Cluster, Plate
from trackslip.logs.runlog import RunLog
from trackslip.logs.scanlog import ScanLog

LASER_SCAN = "sensor_msgs/msg/LaserScan"
_ANGLE, _STEP = 1e-4, 1e-7  # difference of the first angles, and of the steps, of equal scanners [rad]
_MAX_TILT = np.radians(20.0)  # of a scanner's axis to the vertical


@dataclass(frozen=True)
class Scans:
    """Scans by one clock, all with the same beams."""

    source: str
    """The topic."""
    stamp: np.ndarray
    """(S,) int: stamps of the first rays, ascending [ns]."""
    delay: Array  # (S,) times from the stamps to the recording [s]
    ranges: np.ndarray  # (S, B) float32, as published [m]
    first: Any
    """The first message, with angles, limits and frame."""


def scan_topic(bag: Bag, name: str | None = None) -> Topic:
    """The topic of scans, by default the only one; raises LogError if there is none, or a choice."""
    if name is not None:
        return bag.topic(name, LASER_SCAN)
    topics = bag.of_type(LASER_SCAN)
    if not topics:
        raise LogError(f"{bag.path}: no topic of {LASER_SCAN}; its topics are {bag.listed()}")
    return bag.topic(bag.only([topic.name for topic in topics], "scans", "--scan TOPIC"))


def read_scans(bag: Bag, name: str | None, notes: list[str]) -> list[Scans]:
    """The scans of a topic, one for each stretch between restarts of their clock: nearly always one.

    Scans with other beams than most are left out; `notes` gets a line for that. Raises LogError if there are none.
    """
    topic = scan_topic(bag, name)
    alike: dict[Any, list[Any]] = defaultdict(list)
    for message in bag.messages(topic.name):
        scan = message.content
        beams = len(scan.ranges), round(scan.angle_min / _ANGLE), round(scan.angle_increment / _STEP)
        alike[beams].append((message.stamp, message.arrival, np.array(scan.ranges, np.float32), scan))
    usual = max(alike.values(), key=len)
    if others := sum(map(len, alike.values())) - len(usual):
        notes.append(f"topic {topic.name}: {counted(others, 'scan')} with other beams than most left out")
    stamps, arrivals, ranges, scans = zip(*usual, strict=True)
    stamp, arrival, values = np.array(stamps, np.int64), np.array(arrivals, np.int64), np.stack(ranges)
    rows, delay = stretches(topic.name, stamp, arrival, notes), (arrival - stamp) / 1e9
    return [Scans(topic.name, stamp[part], delay[part], values[part], scans[0]) for part in rows]


def plate_log(
    bag: Bag, run: str, stamp: np.ndarray, omega: Array, scans: Scans, plate: Plate, notes: list[str]
) -> tuple[RunLog, str]:
    """The log of a run, with the plate's poses and ranges, and what these were taken from, in words.

    `omega` (E, 2) are the sprocket speeds, means since the previous reading [rad/s], and `stamp` (E,) the stamps of the
    readings, ascending [ns]. The log has a row for each reading and for each scan, with the speeds of the next reading.
    `notes` gets a line for each doubt. Raises LogError, naming topic and cause.
    """
    mount, upside_down, source = _mount(bag, scans, notes)
    time, began = seconds(stamp, int(stamp[0])), seconds(scans.stamp, int(stamp[0]))
    rows = (began >= 0.0) & (began <= time[-1])
    turned = np.concatenate([np.zeros((1, 2)), np.cumsum(omega[1:] * np.diff(time)[:, None], axis=0)])
    angle = np.stack([np.interp(began[rows], time, side) for side in turned.T], axis=-1)
    try:
        raw = RawScans.measured(began[rows], scans.ranges[rows], scans.first, upside_down)
        plates = follow_plate(raw, angle, plate)
    except LogError as error:
        raise LogError(f"{bag.path}: topic {scans.source}: {error}") from error
    notes += plates.notes
    about = {"scans": scans.source, "mount": mount.tolist(), "mount_from": source, "start": int(stamp[0]) / 1e9}
    log = replace(_joined(run, time, omega, plates, plate, mount), metadata={"bag": about})
    return log, f"the plate's in {scans.source}; scanner: {source}"


def _mount(bag: Bag, scans: Scans, notes: list[str]) -> tuple[Array, bool, str]:
    """Pose (3,) of the scanner by the transforms, else the origin, whether it is upside down, and the source."""
    frame = scans.first.header.frame_id
    try:
        fixed = fixed_in(bag, frame, notes) if frame else None
    except LogError as error:
        what = f"topic {scans.source}: {error}: a scanner beside the field is needed, which stands still"
        raise LogError(what) from error
    if fixed is None:
        return np.zeros(3), False, "the scanner is the origin of the poses, and looks along x"
    outer, place, turn = fixed
    ahead, up = turn.as_matrix()[:, 0], turn.as_matrix()[2, 2]
    if abs(up) < np.cos(_MAX_TILT):
        notes.append(f"frame {frame!r} is tilted by {np.degrees(np.arccos(abs(up))):.0f}° in {outer!r}")
    mount = np.array([place[0], place[1], np.arctan2(ahead[1], ahead[0])])
    return mount, bool(up < 0), f"from transforms, in {outer}"


def _joined(run: str, time: Array, omega: Array, plates: FollowedPlate, plate: Plate, mount: Array) -> RunLog:
    """The log of encoders (E,) and plates, in the frame in which the scanner has the pose `mount` (3,)."""
    within = (plates.time <= time[-1]) & (np.diff(plates.time, prepend=-1.0) > 0)
    every = np.union1d(time, plates.time[within])
    rows = np.searchsorted(every, plates.time[within])
    scanner = replace(plates.scanner, mount=mount, background=None)

    def spread(values: np.ndarray, elsewhere: float) -> np.ndarray:
        whole = np.full((len(every), *values.shape[1:]), elsewhere, values.dtype)
        whole[rows] = values[within]
        return whole

    valid, pose = spread(plates.estimate.valid, False), spread(scanner.to_world(plates.estimate.pose), np.nan)
    pose[~valid] = np.nan
    covariance = spread(scanner.covariance_to_world(plates.estimate.covariance), np.nan)
    cluster = Cluster(**{name: spread(values, name == "range") for name, values in vars(plates.cluster).items()})
    speeds, scans = omega[np.searchsorted(time, every)], ScanLog(scanner, plate, cluster)
    return RunLog(run, every, speeds, pose, covariance=covariance, valid=valid, scans=scans)


def fixed_in(bag: Bag, frame: str, notes: list[str]) -> tuple[str, Array, Rotation] | None:
    """The outermost frame that a frame is fixed in, and its place (3,) [m] and rotation there.

    None if there are no transforms of it. Raises LogError, naming the frames, if that frame moves in another one.
    """
    frame = frame.strip("/")
    transforms = read_transforms(bag)
    place, turn, outer, seen = np.zeros(3), Rotation.identity(), frame, {frame}
    while (pair := next((one for one in transforms if one[1] == outer), None)) is not None and pair[0] not in seen:
        links = links_of(pair, transforms[pair], notes)
        if not all(link.is_constant for link in links):
            raise LogError(f"{bag.path}: frame {frame!r} moves in {pair[0]!r}")
        step = Rotation.from_quat(links[0].turn[0])
        place, turn = links[0].place[0] + step.apply(place), step * turn
        outer = pair[0]
        seen.add(outer)
    return None if outer == frame else (outer, place, turn)
