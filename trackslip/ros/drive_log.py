"""The logs of drives in bags: encoders and poses, each with a row of its own."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from trackslip.errors import LogError
from trackslip.logs.runlog import Refused, RunLog, none_usable
from trackslip.logs.table_reader import ReadRuns
from trackslip.ros.bag import Bag, open_bags
from trackslip.ros.checks import DOUBTS, Doubt, Repeated, repeated, sign_doubt, strides
from trackslip.ros.choice import AUTOMATIC, BagChoice
from trackslip.ros.encoders import Encoders, read_encoders
from trackslip.ros.pose_sources import RANKS, PoseSource, Rank, chosen_source
from trackslip.ros.poses import Poses, read_poses
from trackslip.ros.scanned import scanned_drives
from trackslip.ros.stamps import require_overlap, seconds

_MANY = 0.05  # share of poses without encoders that is worth a line
_APART = 1.0  # difference of clocks that is worth a line [s]
_PERHAPS_WHEELS = (Rank.TRANSFORMS, Rank.FUSED, Rank.WHEELS)


def read_bags(path: Path, choice: BagChoice = AUTOMATIC) -> ReadRuns:
    """The drives in a bag, or in all bags of a folder, each a run of its name.

    Raises LogError if nothing can be read, TrackslipError without the package rosbags.
    """
    bags = open_bags(path)
    names = [bag.name for bag in bags]
    runs: list[RunLog] = []
    refused: list[Refused] = []
    notes: list[str] = []
    taken: dict[str, None] = {}
    for bag in bags:
        name = bag.name if names.count(bag.name) == 1 else str(bag.files[0])
        notes += bag.notes
        said: list[str] = []
        try:
            found, what = drive_logs(bag, choice, said, name)
        except LogError as error:
            refused.append(Refused.of(name, error))
            continue
        runs += found
        taken[what] = None
        notes += said if len(bags) == 1 else [f"{name}: {line}" for line in said]
    if not runs:
        raise LogError(refused[0].reason if len(bags) == 1 else none_usable(refused))
    return ReadRuns(tuple(runs), tuple(refused), tuple(notes), tuple(taken))


def drive_logs(bag: Bag, choice: BagChoice, notes: list[str], name: str | None = None) -> tuple[list[RunLog], str]:
    """The drives in a bag, one unless its clock restarts, and a line that says what was taken.

    `notes` gets a line for what is left out, and for what is doubtful. Raises LogError, naming topic and cause.
    """
    if choice.plate is not None:
        drives = scanned_drives(bag, choice, notes, name)
        return [drive.log for drive in drives], drives[0].taken
    name = name or bag.name
    encoders = read_encoders(bag, choice, notes)
    source = chosen_source(bag) if choice.poses is None else PoseSource(choice.poses, Rank.CHOSEN)
    poses = read_poses(bag, source.name, notes)
    if len(encoders) != len(poses):
        raise LogError(
            f"{bag.path}: time goes back {len(encoders) - 1} time(s) in topic {encoders[0].topic} "
            f"and {len(poses) - 1} time(s) in {poses[0].source}"
        )
    several = len(encoders) > 1
    logs = []
    for k, (turned, seen) in enumerate(zip(encoders, poses, strict=True), start=1):
        require_overlap((turned.topic, turned.stamp), (seen.source, seen.stamp))
        outside = int(((seen.stamp < turned.stamp[0]) | (seen.stamp > turned.stamp[-1])).sum())
        if outside > _MANY * len(seen.stamp):
            notes.append(
                f"{seen.source}: {outside} of {len(seen.stamp)} poses left out: {turned.topic} doesn't cover them"
            )
        log = _log(f"{name}, part {k}" if several else name, turned, seen)
        logs.append(_checked(log, turned, seen, source.rank, choice.reversed, notes))
    return logs, _taken(encoders[0], source)


def _taken(encoders: Encoders, poses: PoseSource) -> str:
    """What was taken as encoders and as poses."""
    left, right = (", ".join(side) for side in encoders.joints)
    return f"encoders: {encoders.topic}, left {left}, right {right}; poses: {poses.name} ({RANKS[poses.rank]})"


def _log(name: str, encoders: Encoders, poses: Poses) -> RunLog:
    """A row for each reading of the encoders and for each pose between the first and the last of these."""
    read = encoders.stamp
    within = (poses.stamp >= read[0]) & (poses.stamp <= read[-1])
    stamp = np.union1d(read, poses.stamp[within])
    seen = np.searchsorted(stamp, poses.stamp[within])
    pose = np.full((len(stamp), 3), np.nan)
    pose[seen] = poses.pose[within]
    valid = np.zeros(len(stamp), bool)
    valid[seen] = True
    covariance = None
    if poses.covariance is not None:
        covariance = np.full((len(stamp), 3, 3), np.nan)
        covariance[seen] = poses.covariance[within]
    headed = np.isfinite(pose[:, 2])
    pose[headed, 2] = np.unwrap(pose[headed, 2])
    about = {
        "encoders": encoders.topic,
        "left": list(encoders.joints[0]),
        "right": list(encoders.joints[1]),
        "poses": poses.source,
        "start": int(stamp[0]) / 1e9,
    }
    return RunLog(
        run=name,
        time=seconds(stamp, int(stamp[0])),
        omega=encoders.omega[np.searchsorted(read, stamp)],
        pose=pose,
        covariance=covariance,
        valid=None if valid.all() else valid,
        metadata={"bag": about},
    )


def _checked(
    log: RunLog, encoders: Encoders, poses: Poses, rank: Rank, turned_round: str | None, notes: list[str]
) -> RunLog:
    """The log, with notes of what looks wrong; an encoder that counts backwards beyond doubt is turned round.

    Raises LogError if poses that nobody asked for repeat the wheels.
    """
    apart = encoders.delay - poses.delay
    if abs(apart) > _APART:
        notes.append(
            f"topic {encoders.topic} was recorded {encoders.delay:.3g} s after its stamps, {poses.source} "
            f"{poses.delay:.3g} s after its own: do their clocks differ?"
        )
    motions = strides(log)
    if motions is None:
        return log
    from_wheels = repeated(motions)
    if from_wheels is not None:
        if from_wheels is Repeated.ALL and rank in _PERHAPS_WHEELS:
            raise LogError(
                f"{poses.source}: {from_wheels.value}; --poses chooses others, or these if they were measured"
            )
        notes.append(f"{poses.source}: {from_wheels.value}")
    doubt = sign_doubt(motions)
    if doubt is None:
        return log
    if doubt in (Doubt.LEFT, Doubt.RIGHT) and turned_round is None:
        notes.append(f"topic {encoders.topic}: {DOUBTS[doubt]}: turned round, as with --reversed {doubt.value}")
        return replace(log, omega=log.omega * (1 - 2 * np.array([doubt is Doubt.LEFT, doubt is Doubt.RIGHT])))
    notes.append(f"topic {encoders.topic}: {DOUBTS[doubt]}")
    return log
