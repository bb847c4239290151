"""The logs of drives in bags, and in files of any kind."""

from __future__ import annotations

import warnings
from dataclasses import replace
from pathlib import Path

import numpy as np

from trackslip.errors import InvalidValueError, LogError, LogWarning
from trackslip.logs.logfile import RUNS, read_log, runs_file
from trackslip.logs.runlog import RunLog
from trackslip.logs.table_reader import ReadRuns
from trackslip.ros.bag import Bag, read_each
from trackslip.ros.checks import DOUBTS, REPEATED_POSES, repeated, sign_doubt, strides
from trackslip.ros.choice import AUTOMATIC, SIDES, BagChoice
from trackslip.ros.encoders import Encoders, by_drive, read_encoders
from trackslip.ros.files import is_bag
from trackslip.ros.imu import read_imu, with_gyro
from trackslip.ros.poses import Poses, read_poses
from trackslip.ros.scanned import scanned_drives
from trackslip.ros.sources import PoseOrigin, pose_source
from trackslip.ros.stamps import seconds

_MANY = 0.05  # share of poses without encoders that is worth a line [-]
_APART = 1.0  # difference of clocks that is worth a line [s]
_PERHAPS_WHEELS = (PoseOrigin.TRANSFORMS, PoseOrigin.FUSED, PoseOrigin.WHEELS)


def load(path: str | Path, bag: BagChoice | None = None) -> list[RunLog]:
    """The runs in a folder of results, in a `.parquet` or `.csv` file, or in bags of ROS 1 and ROS 2.

    Rows and runs that cannot be read are left out, each with a LogWarning that says why. `bag` says what to take from
    a bag that leaves a doubt.

    Raises:
        LogError: if no run can be read, or the file is damaged; the message is one line.
        TrackslipError: for a bag, without the package rosbags.
    """
    read = read_runs_of(Path(path), bag or AUTOMATIC)
    for line in read.warnings:
        warnings.warn(f"{path}: {line}", LogWarning, stacklevel=2)
    return list(read.runs)


def read_runs_of(path: Path, bag: BagChoice = AUTOMATIC) -> ReadRuns:
    """The runs in a log of any kind, and what was left out of it; raises LogError if no run can be read."""
    if holds_bags(path):
        return read_bags(path, bag)
    refuse_choice(path, bag)
    return read_log(runs_file(path))


def holds_bags(path: Path) -> bool:
    """True for a bag, or a folder with bags that is no folder of results."""
    try:
        return is_bag(path) and not (path / RUNS).is_file()
    except OSError:
        return False


def refuse_choice(path: Path, bag: BagChoice) -> None:
    """Raise InvalidValueError for choices that a log which is no bag leaves without effect."""
    for name, value in vars(bag).items():
        if value is not None:
            raise InvalidValueError(name, value, f"left out: {path} is no bag")


def read_bags(path: Path, choice: BagChoice = AUTOMATIC) -> ReadRuns:
    """The drives in a bag, or in all bags of a folder, each a run of its name.

    Raises LogError if nothing can be read, TrackslipError without the package rosbags.
    """
    found, refused, notes = read_each(
        path, lambda bag, name, said: _drives(bag, choice, name, said), choice.max_expanded
    )
    taken = dict.fromkeys(what for _, what in found)
    return ReadRuns(tuple(log for log, _ in found), refused, notes, tuple(taken))


def _drives(bag: Bag, choice: BagChoice, name: str, notes: list[str]) -> list[tuple[RunLog, str]]:
    """The drives in a bag, one unless its clock restarts, each with the sources taken, in words.

    `notes` gets a line for what is left out, and for what is doubtful. Raises LogError, naming topic and cause.
    """
    if choice.plate is not None:
        return [(drive.log, drive.taken) for drive in scanned_drives(bag, choice, notes, name)]
    encoders = read_encoders(bag, choice, notes)
    source = pose_source(bag, choice)
    poses = read_poses(bag, source.name, notes)
    try:
        imus = read_imu(bag, choice, notes)
    except LogError as error:
        if choice.imu is not None:
            raise
        imus = []
        notes.append(f"read without gyro: {error}")
    found = []
    for k, (part, turned, seen) in enumerate(by_drive(bag, name, encoders, poses)):
        outside = int(((seen.stamp < turned.stamp[0]) | (seen.stamp > turned.stamp[-1])).sum())
        if outside > _MANY * len(seen.stamp):
            notes.append(
                f"{seen.source}: {outside} of {len(seen.stamp)} poses left out: {turned.topic} doesn't cover them"
            )
        perhaps_wheels = source.origin in _PERHAPS_WHEELS and not choice.dead_reckoned
        log = _checked(_log(part, turned, seen), turned, seen, perhaps_wheels, choice, notes)
        by_gyro = ""
        if len(imus) == len(encoders):
            log, by_gyro = with_gyro(log, imus[k], int(turned.stamp[0]), notes)
        found.append((log, f"{turned.taken}; poses: {source.name} ({source.origin.value}){by_gyro}"))
    return found


def _log(name: str, encoders: Encoders, poses: Poses) -> RunLog:
    """A row for each reading of the encoders and for each pose between the first and the last of these."""
    read = encoders.stamp
    within = (poses.stamp >= read[0]) & (poses.stamp <= read[-1])
    stamp = np.union1d(read, poses.stamp[within])
    valid = np.isin(stamp, poses.stamp[within])
    pose = np.full((len(stamp), 3), np.nan)
    pose[valid] = poses.pose[within]
    covariance = None
    if poses.covariance is not None:
        covariance = np.full((len(stamp), 3, 3), np.nan)
        covariance[valid] = poses.covariance[within]
    headed = np.isfinite(pose[:, 2])
    pose[headed, 2] = np.unwrap(pose[headed, 2])
    about = {**encoders.about, "poses": poses.source, "start": int(stamp[0]) / 1e9}
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
    log: RunLog, encoders: Encoders, poses: Poses, perhaps_wheels: bool, choice: BagChoice, notes: list[str]
) -> RunLog:
    """The log, with notes of what looks wrong; an encoder that counts backwards beyond doubt is turned round.

    Raises LogError if poses that nobody asked for repeat the wheels.
    """
    if abs(encoders.delay - poses.delay) > _APART:
        notes.append(
            f"topic {encoders.topic} was recorded {encoders.delay:.3g} s after its stamps, {poses.source} "
            f"{poses.delay:.3g} s after its own: do their clocks differ?"
        )
    motions = strides(log)
    if motions is None:
        return log
    from_wheels = repeated(motions)
    if from_wheels == REPEATED_POSES and perhaps_wheels:
        raise LogError(f"{poses.source}: {from_wheels}; --poses chooses others, or these if they were measured")
    if from_wheels is not None:
        notes.append(f"{poses.source}: {from_wheels}")
    doubt = None if choice.reversed == "none" else sign_doubt(motions)
    if doubt is None:
        return log
    line = f"topic {encoders.topic}: {DOUBTS[doubt]}"
    if doubt not in SIDES or choice.reversed is not None:
        notes.append(line)
        return log
    notes.append(f"{line}: turned round, as with --reversed {doubt}")
    return replace(log, omega=log.omega * [-1.0 if side == doubt else 1.0 for side in SIDES])
