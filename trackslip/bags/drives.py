"""The logs of drives in bags, and in files of any kind."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from trackslip.bags.checks import REPEATED, backward_encoder, repeat_wheels, strides
from trackslip.bags.choice import AUTOMATIC, SIDES, BagChoice
from trackslip.bags.encoders import Encoders, by_drive, read_encoders
from trackslip.bags.imu import Imu, read_imu, with_gyro
from trackslip.bags.open import Bag, is_bag, read_each
from trackslip.bags.poses import Poses, read_poses
from trackslip.bags.scans import plate_log, read_scans
from trackslip.bags.stamps import clocks_apart, seconds
from trackslip.bags.topics import IMU, PoseOrigin, pose_source
from trackslip.errors import InvalidValueError, LogError, LogWarning
from trackslip.logs.logfile import RUNS, read_log, runs_file
from trackslip.logs.runlog import RunLog
from trackslip.logs.table_reader import ReadRuns

_MANY = 0.05  # share of poses without encoders that is worth a line [-]
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
    found, refused, notes = read_each(path, lambda bag, name, said: _drives(bag, choice, name, said))
    taken = dict.fromkeys(what for _, what in found)
    return ReadRuns(tuple(log for log, _ in found), refused, notes, tuple(taken))


def _drives(bag: Bag, choice: BagChoice, name: str, notes: list[str]) -> list[tuple[RunLog, str]]:
    """The drives in a bag, one unless its clock restarts, each with the sources taken, in words.

    `notes` gets a line for what is left out, and for what is doubtful. Raises LogError, naming topic and cause.
    """
    encoders = read_encoders(bag, choice, notes)
    found = []
    if choice.plate is not None:
        for part, turned, scans in by_drive(bag, name, encoders, read_scans(bag, choice.scan, notes)):
            log, taken = plate_log(bag, part, turned.stamp, turned.omega, scans, choice.plate, notes)
            log.metadata["bag"].update(turned.about)
            found.append((log, f"{turned.taken}; poses: {taken}"))
        return found
    source = pose_source(bag, choice)
    poses = read_poses(bag, source.name, notes)
    imus = _imus(bag, choice, notes)
    for k, (part, turned, seen) in enumerate(by_drive(bag, name, encoders, poses)):
        _note_clocks(turned, seen, notes)
        perhaps_wheels = source.origin in _PERHAPS_WHEELS and not choice.dead_reckoned
        log = _checked(_log(part, turned, seen), bag, turned, seen.source, perhaps_wheels, choice, notes)
        taken = f"{turned.taken}; poses: {source.name} ({source.origin.value})"
        if source.origin is PoseOrigin.IMU and not log.is_valid.any():
            taken = f"{turned.taken}; no poses"
        if len(imus) == len(encoders):
            log, by_gyro = with_gyro(log, imus[k], int(turned.stamp[0]), notes)
            taken += by_gyro
        found.append((log, taken))
    return found


def _imus(bag: Bag, choice: BagChoice, notes: list[str]) -> Sequence[Imu]:
    """The readings of the gyro; raises LogError if they were asked for and can't be read."""
    try:
        return read_imu(bag, choice, notes)
    except LogError as error:
        if choice.imu is not None:
            raise
        notes.append(f"read without gyro: {error}")
        return []


def _note_clocks(encoders: Encoders, poses: Poses, notes: list[str]) -> None:
    """Note poses that the encoders don't cover, and clocks that differ."""
    outside = int(((poses.stamp < encoders.stamp[0]) | (poses.stamp > encoders.stamp[-1])).sum())
    if outside > _MANY * len(poses.stamp):
        total = len(poses.stamp)
        notes.append(f"{poses.source}: {outside} of {total} poses left out: {encoders.topic} doesn't cover them")
    apart = clocks_apart(encoders.delay, poses.delay)
    if apart:
        notes.append(f"topics {encoders.topic} and {poses.source}: {apart}")


def _log(name: str, encoders: Encoders, poses: Poses) -> RunLog:
    """A row for each reading of the encoders and for each pose between the first and the last of these."""
    read = encoders.stamp
    within = (poses.stamp >= read[0]) & (poses.stamp <= read[-1]) & np.isfinite(poses.pose).any(axis=1)
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
    beyond = None
    if not within.all():
        beyond = np.column_stack([seconds(poses.stamp[~within], int(stamp[0])), poses.pose[~within]])
    about = {**encoders.about, "poses": poses.source, "start": int(stamp[0]) / 1e9}
    return RunLog(
        run=name,
        time=seconds(stamp, int(stamp[0])),
        omega=encoders.omega[np.searchsorted(read, stamp)],
        pose=pose,
        covariance=covariance,
        valid=None if valid.all() else valid,
        beyond=beyond,
        metadata={"bag": about},
    )


def _checked(
    log: RunLog, bag: Bag, encoders: Encoders, source: str, perhaps_wheels: bool, choice: BagChoice, notes: list[str]
) -> RunLog:
    """The log; an encoder that counts backwards beyond doubt is turned round, with a note.

    Raises LogError if poses that nobody asked for repeat the wheels.
    """
    motions = strides(log)
    if motions is None:
        return log
    if repeat_wheels(motions):
        if perhaps_wheels:
            imus = [topic.name for topic in bag.of_type(IMU)]
            headings = f", {imus[0]} takes only the headings of an IMU" if imus else ""
            raise LogError(f"{source}: {REPEATED}; --poses chooses others, or these if they were measured{headings}")
        notes.append(f"{source}: {REPEATED}")
    backwards = backward_encoder(motions) if choice.reversed is None else None
    if backwards is None:
        return log
    line = f"topic {encoders.topic}: the {backwards} encoder counts backwards"
    notes.append(f"{line}: turned round, as with --reversed {backwards}")
    return replace(log, omega=log.omega * [-1.0 if side == backwards else 1.0 for side in SIDES])
