"""Runs from a bag with encoders and scans, where a stationary laser range finder sees a plate on
the robot.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from trackslip.bags.encoders import Encoders, joined
from trackslip.bags.open import Bag
from trackslip.bags.stamps import Readings, clocks_apart, seconds
from trackslip.bags.topics import scan_topic
from trackslip.bags.transforms import MAX_TILT, heading_and_tilt, read_fixed
from trackslip.errors import LogError, counted
from trackslip.kinematics import Array
from trackslip.localization.raw_scans import RawScans, follow_plate
from trackslip.localization.scan import Plate
from trackslip.logs.runlog import RunLog, ScanLog


@dataclass(frozen=True)
class Scans(Readings):
    """Ranges (S, B) of scans with the same beams [m], stamped at the first beam of each scan."""

    first: Any  # first message, with angles, limits and frame


def read_scans(bag: Bag, name: str | None, notes: list[str]) -> Scans:
    """Read the scans of a topic.

    Scans whose beams differ from most scans' are left out, with a line in `notes`. Raises LogError
    without scans.
    """
    topic = scan_topic(bag, name)
    first: dict[Any, Any] = {}

    def ranges(scan: Any) -> list[tuple[Any, Any, Any]]:
        beams = len(scan.ranges), round(scan.angle_min, 4), round(scan.angle_increment, 7)
        first.setdefault(beams, scan)
        return [(beams, scan.header, scan.ranges)]

    by_beams = bag.readings([topic.name], ranges)
    if not by_beams:
        raise LogError(f"topic {topic.name}: no messages")
    usual = max(by_beams, key=lambda beams: len(by_beams[beams].stamp))
    if others := sum(len(scans.stamp) for beams, scans in by_beams.items() if beams != usual):
        notes.append(
            f"topic {topic.name}: {counted(others, 'scan')} with other beams than most left out"
        )
    return Scans(**vars(by_beams[usual].ascending(notes)), first=first[usual])


def plate_log(
    bag: Bag, run: str, encoders: Encoders, scans: Scans, plate: Plate, notes: list[str]
) -> tuple[RunLog, str]:
    """Make the log of a run with the plate's poses and ranges; returns it with a description of the
    sources used.

    Adds a line to `notes` for each doubt. Raises LogError, with topic and cause, if the plate can't
    be followed.
    """
    notes += clocks_apart(encoders, scans)
    mount, upside_down, source = _mount(bag, scans, notes)
    start = int(encoders.stamp[0])
    time, began = seconds(encoders.stamp, start), seconds(scans.stamp, start)
    rows = (began >= 0.0) & (began <= time[-1])
    angle = np.stack([np.interp(began[rows], time, side) for side in encoders.turned.T], axis=-1)
    try:
        raw = RawScans.measured(
            began[rows], scans.values[rows].astype(np.float32), scans.first, upside_down
        )
        plates = follow_plate(raw, angle, plate)
    except LogError as error:
        raise LogError(f"{bag.path}: topic {scans.source}: {error}") from error
    notes += plates.notes
    scanner = replace(plates.scanner, mount=mount, background=None)
    stamp = start + np.rint(1e9 * plates.time).astype(np.int64)
    kept = (
        plates.estimate.valid
        & (np.diff(stamp, prepend=start - 1) > 0)
        & (stamp <= encoders.stamp[-1])
    )
    poses = scanner.to_world(plates.estimate.pose)[kept]
    log = joined(run, encoders, Readings(scans.source, stamp[kept], stamp[kept], poses))
    log.metadata["bag"] |= {"mount": mount.tolist(), "mount_from": source}
    cluster = plates.cluster.take(np.flatnonzero(kept)).among(log.is_valid)
    log = replace(log, scans=ScanLog(scanner, plate, cluster))
    return log, f"{encoders.taken}; poses: the plate's in {scans.source}; scanner: {source}"


def _mount(bag: Bag, scans: Scans, notes: list[str]) -> tuple[Array, bool, str]:
    """The scanner's pose (3,), from transforms or 0; whether the scanner is upside down; the source
    of its pose.
    """
    frame = scans.first.header.frame_id
    try:
        fixed = read_fixed(bag, frame, notes) if frame else None
    except LogError as error:
        what = (
            f"topic {scans.source}: {error}: a scanner beside the field is needed, which "
            "stands still"
        )
        raise LogError(what) from error
    if fixed is None:
        return np.zeros(3), False, "the scanner is the origin of the poses, and looks along x"
    outer, place, turn = fixed
    heading, tilt = heading_and_tilt(turn)
    upside_down = bool(tilt > np.pi / 2)
    if min(tilt, np.pi - tilt) > MAX_TILT:
        notes.append(
            f"frame {frame!r} is tilted by {np.degrees(min(tilt, np.pi - tilt)):.0f}° in {outer!r}"
        )
    return np.array([place[0], place[1], heading]), upside_down, f"from transforms, in {outer}"
