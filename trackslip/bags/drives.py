"""Logs of drives, from bags and from files of any kind."""

from __future__ import annotations

import warnings
from collections.abc import Mapping
from itertools import pairwise
from pathlib import Path
from typing import Final

import numpy as np

from trackslip import se2
from trackslip.arguments import checks_arguments
from trackslip.bags.choice import AUTOMATIC, BagChoice
from trackslip.bags.encoders import joined, read_encoders
from trackslip.bags.open import Bag, bags_in, open_bags
from trackslip.bags.poses import read_imu, read_poses, with_gyro
from trackslip.bags.scans import plate_log, read_scans
from trackslip.bags.stamps import clocks_apart
from trackslip.bags.topics import IMU, PoseOrigin, encoder_topics, pose_source
from trackslip.errors import InvalidValueError, LogError, LogWarning, counted, require
from trackslip.kinematics import Array, RobotGeometry
from trackslip.logs.checks import LONGEST_STEP
from trackslip.logs.layout import AS_DOCUMENTED, Layout
from trackslip.logs.logfile import RUNS, read_log, runs_file, runs_in
from trackslip.logs.runlog import Refused, RunLog, none_usable
from trackslip.logs.table_reader import ReadRuns, RunsInTables

REPEATED: Final = "its poses repeat the dead reckoning of the wheels: they say nothing about slip"
_STRIDE: Final = 1.0  # time step over which the motions of poses and wheels are compared [s]
_MIN_STRIDES: Final = 10  # number of strides up to which a comparison is inconclusive
# largest relative residual of poses computed from the wheels; noise-free poses with slip reach 6e-3
_EXACT: Final = 5e-3
_DELAYS: Final = (0.0, 0.05)  # delays of odometry behind the wheels that are combined [s]
_PERHAPS_WHEELS: Final = (PoseOrigin.TRANSFORMS, PoseOrigin.FUSED, PoseOrigin.WHEELS)


@checks_arguments
def load(
    path: str | Path,
    bag: BagChoice | None = None,
    max_memory: int | None = None,
    *,
    columns: str | Mapping[str, str] | None = None,
    ticks_per_turn: float | None = None,
    odometry: RobotGeometry | None = None,
) -> list[RunLog]:
    """Load the runs in a results folder, in a `.parquet` or `.csv` file, or in ROS 1 or ROS 2 bags.

    Unreadable rows and runs are left out, each with a LogWarning that states the reason. `bag`
    chooses topics and joints if these are ambiguous in a bag. Reading takes at most `max_memory`
    [bytes], by default half of the machine's memory, whatever a file unpacks to.

    `columns` names the columns of a table that are called otherwise than ours, with their units, as
    in `{"t": "stamp:ms", "omega_l": "left_rpm:rpm"}`. Encoders that count need `ticks_per_turn`,
    and odometry that replaces encoders the geometry with which it was computed.

    Raises:
        LogError: if no run can be read, the file is damaged or takes more memory; the message is
            one line.
        InvalidValueError: for columns that don't exist, or if ticks per turn or the odometry's
            geometry are needed.
        TrackslipError: for a bag, if the package rosbags is not installed.
    """
    layout = Layout(columns, ticks_per_turn, odometry)
    read = read_runs_of(Path(path), bag or AUTOMATIC, max_memory, layout)
    for line in read.warnings:
        warnings.warn(f"{path}: {line}", LogWarning, stacklevel=2)
    return list(read.runs)


def read_runs_of(
    path: Path,
    bag: BagChoice = AUTOMATIC,
    max_memory: int | None = None,
    layout: Layout = AS_DOCUMENTED,
) -> ReadRuns:
    """Read the runs in a log of any kind, with notes on the parts left out; raises LogError if no
    run can be read, or if reading takes more than `max_memory` [bytes].
    """
    if holds_bags(path):
        return read_bags(path, bag, max_memory, layout)
    refuse_choice(path, bag)
    return read_log(runs_file(path), max_memory, layout)


def runs_of(
    path: Path,
    bag: BagChoice = AUTOMATIC,
    max_memory: int | None = None,
    layout: Layout = AS_DOCUMENTED,
) -> ReadRuns | RunsInTables:
    """The runs in a log of any kind, to iterate over: from a table, one run at a time is in memory.

    Raises LogError if no run can be read, for a table at the end of the iteration, or if reading
    takes more than `max_memory` [bytes].
    """
    if holds_bags(path):
        return read_bags(path, bag, max_memory, layout)
    refuse_choice(path, bag)
    return runs_in(runs_file(path), max_memory, layout)


def holds_bags(path: Path) -> bool:
    """True for a bag, and for a folder of bags that is not a results folder."""
    try:
        return not (path / RUNS).is_file() and bool(bags_in(path))
    except OSError:
        return False


def refuse_choice(path: Path, bag: BagChoice) -> None:
    """Raise InvalidValueError if any choice is made for a log that is not a bag: the choice would
    have no effect.
    """
    for name, value in vars(bag).items():
        if value is not None:
            raise InvalidValueError(name, value, f"left out: {path} is no bag")


def read_bags(
    path: Path,
    choice: BagChoice = AUTOMATIC,
    max_memory: int | None = None,
    layout: Layout = AS_DOCUMENTED,
) -> ReadRuns:
    """Read the drives in a bag, or in all bags in a folder, each as a run with the bag's name.

    Raises LogError if no drive can be read, or if reading takes more than `max_memory` [bytes];
    TrackslipError if the package rosbags is not installed.
    """
    require(layout.columns is None, "columns", layout.columns, f"left out: {path} is a bag")
    bags = open_bags(path, max_memory)
    runs: list[RunLog] = []
    refused: list[Refused] = []
    notes: list[str] = []
    taken: dict[str, None] = {}
    for bag in bags:
        name = bag.name if sum(other.name == bag.name for other in bags) == 1 else str(bag.path)
        of_bag: list[str] = []
        try:
            drives = _drives_in(bag, choice, name, of_bag)
        except LogError as error:
            drives = {}
            refused.append(Refused.of(name, error))
        for part, drive in drives.items():
            try:
                log, sources = _read_drive(drive, choice, layout, part, of_bag)
            except LogError as error:
                refused.append(Refused.of(part, error))
            else:
                runs.append(log)
                taken[sources] = None
        notes += [
            *bag.notes,
            *(of_bag if len(bags) == 1 else (f"{name}: {line}" for line in of_bag)),
        ]
    if not runs:
        raise LogError(refused[0].reason if len(bags) == 1 else none_usable(refused))
    return ReadRuns(tuple(runs), tuple(refused), tuple(notes), tuple(taken))


def _drives_in(bag: Bag, choice: BagChoice, name: str, notes: list[str]) -> dict[str, Bag]:
    """The drives in a bag called `name`: a single drive, unless the clock of the encoders' topic
    restarts or has gaps.
    """
    topic = encoder_topics(bag, choice)[0][0].name
    restarts, after_gaps = bag.stamps(topic).breaks()
    starts = np.union1d(restarts, after_gaps)
    if not len(starts):
        return {name: bag}
    if len(restarts):
        notes.append(f"topic {topic}: time goes back: read as {len(restarts) + 1} drives")
    if len(after_gaps):
        notes.append(
            f"topic {topic}: {counted(len(after_gaps), 'gap')} of more than {LONGEST_STEP:g} s "
            "without a message: the drive is cut there"
        )
    edges = [0, *starts.tolist(), np.iinfo(np.int64).max]
    return {
        f"{name}, part {k}": bag.between(*ends) for k, ends in enumerate(pairwise(edges), start=1)
    }


def _read_drive(
    bag: Bag, choice: BagChoice, layout: Layout, name: str, notes: list[str]
) -> tuple[RunLog, str]:
    """Read the log of a drive; returns it with a description of the sources used.

    Adds a line to `notes` for each part left out and each doubt. Raises LogError, with topic and
    cause.
    """
    encoders = read_encoders(bag, choice, notes, layout)
    if choice.plate is not None:
        return plate_log(
            bag, name, encoders, read_scans(bag, choice.scan, notes), choice.plate, notes
        )
    source = pose_source(bag, choice)
    poses = read_poses(bag, source.name, notes)
    notes += clocks_apart(encoders, poses)
    log = joined(name, encoders, poses)
    moves, turns = _repeats_wheels(log)
    if moves and turns:
        if source.origin in _PERHAPS_WHEELS and not choice.dead_reckoned:
            topics = bag.of_type(IMU)
            headings = f", {topics[0].name} takes only the headings of an IMU" if topics else ""
            raise LogError(
                f"{poses.source}: {REPEATED}; --poses chooses others, or these if "
                f"measured{headings}"
            )
        notes.append(f"{poses.source}: {REPEATED}")
    elif moves:
        notes.append(
            f"{poses.source}: its distances repeat those of the wheels: they say nothing about ε"
        )
    has_poses = source.origin is not PoseOrigin.IMU or log.is_valid.any()
    taken = encoders.taken + (
        f"; poses: {source.name} ({source.origin.value})" if has_poses else "; no poses"
    )
    try:
        imu = read_imu(bag, choice, notes)
    except LogError as error:
        if choice.imu is not None:
            raise
        notes.append(f"read without gyro: {error}")
        imu = None
    log, by_gyro = (log, "") if imu is None else with_gyro(log, imu, int(encoders.stamp[0]), notes)
    return log, taken + by_gyro


def _repeats_wheels(log: RunLog) -> tuple[bool, bool]:
    """Whether distances, and turns, of the poses follow the sprockets exactly; as tracks slip,
    measured poses don't.

    Distances don't depend on whether dead reckoning used the heading at the start or the end of a
    step. Odometry may be late: linear combinations of the wheels' motions at two delays approximate
    the motions at any delay.
    """
    rows = np.flatnonzero(log.has_place & log.has_heading)
    if not len(rows):
        return False, False
    time = log.time[rows]
    pose = log.pose[rows]
    ends = np.unique(np.searchsorted(time, np.arange(time[0], time[-1], _STRIDE)))
    if len(ends) <= _MIN_STRIDES:
        return False, False

    # the angles of the sprockets, and the direction of the robot between poses
    origin = np.zeros((1, 2))
    increments = log.omega[1:] * np.diff(log.time)[:, None]
    angles = np.concatenate([origin, np.cumsum(increments, axis=0)])
    middle_heading = pose[:-1, 2] + np.diff(pose[:, 2]) / 2
    ahead = se2.direction(middle_heading)

    # distances and turns in each stride by the wheels, at two delays
    distances = list[Array]()
    turns = list[Array]()
    for delay in _DELAYS:
        turned = np.stack([np.interp(time - delay, log.time, side) for side in angles.T], axis=-1)
        steps = np.diff(turned.mean(axis=1))[:, None] * ahead
        reckoned = np.concatenate([origin, np.cumsum(steps, axis=0)])
        distances.append(_lengths(reckoned[ends]))
        turns.append(np.diff(turned[ends] @ [-1.0, 1.0]))

    repeats_distances = _combines(_lengths(pose[ends, :2]), distances)
    repeats_turns = _combines(np.diff(pose[ends, 2]), turns)
    return repeats_distances, repeats_turns


def _lengths(places: Array) -> Array:
    """Distances (n,) between successive places (n + 1, 2)."""
    x_step, y_step = np.diff(places, axis=0).T
    return np.asarray(np.hypot(x_step, y_step))


def _combines(motion: Array, by_wheels: list[Array]) -> bool:
    """True if `motion` (n,) is a linear combination of `by_wheels` to within _EXACT; false if
    nothing moves.
    """
    columns = np.stack(by_wheels, axis=-1)
    rest = motion - columns @ np.linalg.lstsq(columns, motion)[0]
    return bool(
        motion.any() and columns.any() and np.linalg.norm(rest) <= _EXACT * np.linalg.norm(motion)
    )
