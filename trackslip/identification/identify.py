"""From logs to slip laws: the whole identification in one call."""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from dataclasses import replace
from pathlib import Path

from trackslip.doubts import Accepted, in_few_lines
from trackslip.errors import InvalidValueError, LogError
from trackslip.identification.comparison import DriveComparison, compare_drives, compare_laws
from trackslip.identification.drives import MAX_POSES, drives_of
from trackslip.identification.outliers import split_outliers
from trackslip.identification.result import Identification, Method
from trackslip.identification.samples import Sampling
from trackslip.identification.sensor import with_sensor
from trackslip.identification.source import ReadOptions, Source, read_source, source_of_runs
from trackslip.kinematics import RobotGeometry
from trackslip.logs.runlog import Refused, RunLog
from trackslip.motion.constant_speed import SETTLE
from trackslip.ros.choice import AUTOMATIC, BagChoice
from trackslip.se2 import Mounting

_MIN_SAMPLES = 4  # steady samples that identify laws without the rest of the driving
_MIN_STEADY = 0.5  # share of the driving that is steady, if steady stretches are to identify the laws [-]
_BESIDE = ("none", "icr", "icr_radius")  # laws of whole drives beside those of steady stretches
_POSES_BESIDE = 6000  # poses used for them


def identify(
    source: str | Path | RunLog | Sequence[RunLog],
    geometry: RobotGeometry | None = None,
    *,
    method: Method | None = None,
    sensor: Mounting | None = None,
    estimate_sensor: bool | None = None,
    gear: float = 1.0,
    settle: float = SETTLE,
    motion: str | None = None,
    bag: BagChoice | None = None,
    accept: Sequence[Accepted] = (),
) -> Identification:
    """Identify slip laws from steady runs or from any driving.

    Args:
        source: a folder of results, a `.parquet` or `.csv` file of traces or steady samples, a bag of ROS 1 or ROS 2, a
            folder of bags, or runs in memory.
        geometry: of the robot; needed if the log does not state it.
        method: steady: from stretches of constant sprocket speeds; drive: from whole drives. By default steady where
            most of the driving is, else drive.
        sensor: place and yaw on the robot of the sensor that measured the poses, if known.
        estimate_sensor: whether to estimate them from steady stretches; by default where the driving determines them.
        gear: turns of the encoder per turn of the sprocket, if omega is the speed of the encoder [-].
        settle: time after the sprockets have become steady that is left out of each run [s].
        motion: how a steady run becomes a twist: paper, arc or bundle; by default the most accurate method
            that each run allows.
        bag: which topics of a bag are encoders and poses; needed if the bag leaves a doubt.
        accept: data to use although they look wrong: runs with odd `headings`, implausible slip (`units`), belts that
            move against their sprockets (`signs`) or `unsteady` motion, `outliers`, and `short` drives.

    Raises:
        LogError: if the log cannot be read, or its runs determine no law.
        InvalidValueError: for an invalid option, or if neither `geometry` nor the log states the geometry.
    """
    b, r = (geometry.half_gauge, geometry.sprocket_radius) if geometry else (None, None)
    reading = ReadOptions(b, r, gear, settle, motion, bag or AUTOMATIC, tuple(accept))
    if isinstance(source, str | Path):
        found = read_source(Path(source), reading)
    else:
        found = source_of_runs([source] if isinstance(source, RunLog) else list(source), reading)
    return identify_source(found, method, sensor, estimate_sensor)


def identify_source(
    source: Source,
    method: Method | None = None,
    sensor: Mounting | None = None,
    estimate_sensor: bool | None = None,
    step: Callable[[float], None] = lambda _: None,
) -> Identification:
    """Identify laws from a source that was read, like `identify`; `step(1.0)` is called after each stage or law."""
    if method not in (None, "steady", "drive"):
        raise InvalidValueError("method", method, "steady or drive")
    steady: Identification | None = None
    reason = ""
    if method != "drive":
        if estimate_sensor is None and sensor is None and source.logs and all(map(_centred, source.logs)):
            estimate_sensor = False
        try:
            accept = source.reading.accept
            steady = identify_samples(source.sampling, source.geometry, source.logs, sensor, estimate_sensor, accept)
        except LogError as error:
            reason = str(error)
    step(1.0)
    if method == "steady":
        if steady is None:
            raise LogError(reason)
        return steady
    if not source.logs:
        if steady is None or method == "drive":
            raise LogError(reason or "holds steady samples, not traces: only method steady can be used")
        return steady
    main = steady is None or not _mostly_steady(source.sampling)
    try:
        drive, refused = _drive(source, sensor, None if main else _POSES_BESIDE, None if main else _BESIDE, step)
    except LogError as error:
        if steady is None:
            both = f"{error}; from steady stretches: {reason}"
            raise LogError(both if reason and method is None else str(error)) from error
        return replace(steady, warnings=(*steady.warnings, f"from whole drives nothing was identified: {error}"))
    if steady is None or len(steady.samples) < _MIN_SAMPLES:
        out = (*source.refused, *refused)
        lines = (*source.notes, *(one.doubt for one in out), *drive.warnings)
        warnings = in_few_lines(lines, len(source.logs) + len(source.refused))
        return Identification(source.geometry, "drive", None, drive, out, warnings, source.logs)
    lines = in_few_lines((*(one.doubt for one in refused), *drive.warnings), len(source.logs))
    if main:
        beside = [f"from steady stretches: {line}" for line in steady.warnings]
        return replace(steady, method="drive", drive=drive, warnings=(*lines, *beside))
    return replace(steady, drive=drive, warnings=(*steady.warnings, *(f"from whole drives: {line}" for line in lines)))


def identify_samples(
    sampling: Sampling,
    geometry: RobotGeometry,
    logs: tuple[RunLog, ...] = (),
    sensor: Mounting | None = None,
    estimate_sensor: bool | None = False,
    accept: Collection[str] = (),
) -> Identification:
    """Leave out outliers, fit and compare the laws; raises LogError if the samples determine no law.

    For `sensor` and `estimate_sensor` see `with_sensor`; by default the sensor is at the robot's centre. `accept` are
    doubts to ignore.
    """
    centred, _, notes = with_sensor(sampling.samples, geometry, sensor, estimate_sensor)
    samples, outliers = (centred, []) if "outliers" in accept else split_outliers(centred, geometry)
    steady, left_out = compare_laws(samples, geometry), (*sampling.refused, *outliers)
    lines = (*sampling.notes, *notes, *(one.doubt for one in left_out), *steady.warnings)
    warnings = in_few_lines(lines, len(samples) + len(left_out))
    return Identification(geometry, "steady", steady, None, left_out, warnings, logs)


def _drive(
    source: Source,
    sensor: Mounting | None,
    most: int | None,
    names: Sequence[str] | None,
    step: Callable[[float], None],
) -> tuple[DriveComparison, list[Refused]]:
    drives, refused = drives_of(source.logs, most or MAX_POSES)
    return compare_drives(drives, source.geometry, sensor, names, step), refused


def _mostly_steady(sampling: Sampling) -> bool:
    """True if steady stretches make up most of the driving."""
    return len(sampling.samples) >= _MIN_SAMPLES and sampling.steady_share >= _MIN_STEADY


def _centred(log: RunLog) -> bool:
    """True for a simulated run with the poses of the plate, which stands on the robot's centre."""
    return "plate" in log.metadata and "source" not in log.metadata
