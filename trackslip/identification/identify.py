"""From logs to slip laws: the whole identification in one call.

`identify` reads a log, and `identify_source` takes it to the laws, step by step. For whole drives,
the path goes on in `drives.conditioning.drives_of`, `drives.first_look.first_look`,
`drive_comparison.compare_drives`, `law_fit.fit_drives` and `windows.fit_windows`; for steady runs,
in `samples.usable_samples` and `steady.compare_laws`.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Final, Protocol, runtime_checkable

from trackslip.arguments import checks_arguments
from trackslip.bags.choice import AUTOMATIC, BagChoice
from trackslip.drives.conditioning import drives_of
from trackslip.drives.first_look import first_look
from trackslip.errors import LogError, require
from trackslip.identification.comparison import REFERENCE
from trackslip.identification.drive_comparison import DriveComparison, compare_drives
from trackslip.identification.result import Identification, Method
from trackslip.identification.samples import Sampling
from trackslip.identification.source import (
    ReadOptions,
    Source,
    read_source,
    source_of_frame,
    source_of_runs,
)
from trackslip.identification.steady import compare_laws
from trackslip.kinematics import RobotGeometry
from trackslip.logs.layout import Layout
from trackslip.logs.runlog import Refused, RunLog
from trackslip.motion.steady import SETTLE, turning_stretches
from trackslip.se2 import Mounting

_FEWEST_RUNS: Final = 4  # least number of steady runs, of which laws can be compared
_STEADY_SHARE: Final = 0.5  # least share of the driving time that is steady, settling included [-]


@runtime_checkable
class SupportsArrowStream(Protocol):
    """A data frame that other libraries can read through Arrow's PyCapsule protocol."""

    def __arrow_c_stream__(self, requested_schema: object = None) -> object:
        """Export the data frame as a stream."""


@checks_arguments
def identify(
    source: str | Path | RunLog | Sequence[RunLog] | SupportsArrowStream,
    geometry: RobotGeometry | None = None,
    *,
    method: Method | None = None,
    sensor: Mounting | None = None,
    gear: float = 1.0,
    settle: float = SETTLE,
    motion: str | None = None,
    bag: BagChoice | None = None,
    multiplier: float | None = None,
    lag: bool = False,
    max_memory: int | None = None,
    columns: str | Mapping[str, str] | None = None,
    ticks_per_turn: float | None = None,
    odometry: RobotGeometry | None = None,
) -> Identification:
    """Identify slip laws from steady runs or from any driving.

    Args:
        source: a results folder, a `.parquet` or `.csv` file of traces or steady samples, a ROS 1
            or ROS 2 bag, a folder of bags, runs in memory (see also `RunLog.from_arrays`), or a
            data frame with the columns of a log: of pandas, Polars, PyArrow or any other library
            with Arrow's `__arrow_c_stream__`.
        geometry: the robot's geometry; needed if the log does not state it.
        method: "steady" uses stretches of constant sprocket speeds, "drive" whole drives. The
            default is "steady" if most of the driving is steady, otherwise "drive".
        sensor: place [m] and yaw [rad], in the robot's frame, of the sensor that measured the
            poses, if known.
        gear: turns of the encoder per turn of the sprocket, if the log has the encoder's speed [-].
        settle: time skipped at the start of each steady stretch [s].
        motion: how the twists of steady stretches are estimated: "paper", "arc" or "bundle"; by
            default the most accurate that each run allows.
        bag: what to read from a ROS bag.
        multiplier: `wheel_separation_multiplier` with which odometry that replaces encoders was
            computed, if known [-].
        max_memory: most memory for the content of the log [bytes]; by default half of the
            machine's.
        lag: whether to estimate the time by which the motion lags behind the belts; only from whole
            drives.
        columns: the columns of a table or data frame that are called otherwise than in the
            documentation, with their units, as in `{"t": "stamp:ms", "omega_l": "left_rpm:rpm"}`,
            or as text, `"t=stamp:ms,omega_l=left_rpm:rpm"`.
        ticks_per_turn: ticks per turn of the encoder, for the columns `ticks_l` and `ticks_r`, or
            counters in a bag.
        odometry: geometry with which odometry that replaces encoders was computed; by default the
            robot's.

    Raises:
        LogError: if the log cannot be read, or its runs determine no law.
        InvalidValueError: for an invalid option, or if neither `geometry` nor the log states the
            geometry.
    """
    # options, for all kinds of sources alike
    reading = ReadOptions(
        half_gauge=geometry.half_gauge if geometry else None,
        sprocket_radius=geometry.sprocket_radius if geometry else None,
        gear=gear,
        settle=settle,
        motion=motion,
        bag=bag or AUTOMATIC,
        multiplier=multiplier,
        layout=Layout(columns, ticks_per_turn, odometry),
        max_memory=max_memory,
    )
    # runs, or samples of steady runs
    if isinstance(source, str | Path):
        read = read_source(Path(source), reading)
    elif isinstance(source, RunLog):  # before data frames, as it exports one, too
        read = source_of_runs([source], reading)
    elif isinstance(source, SupportsArrowStream):
        read = source_of_frame(source, reading)
    else:
        read = source_of_runs(list(source), reading)
    return identify_source(read, method, sensor, lag=lag)


def identify_source(
    source: Source,
    method: Method | None = None,
    sensor: Mounting | None = None,
    step: Callable[[float], None] = lambda _: None,
    lag: bool = False,
) -> Identification:
    """Identify laws as `identify` does, from a source in memory; `step(1.0)` is called after each
    stage or law.
    """
    # 1. The method that is asked for, or the one that suits the driving. Samples aren't driving.
    require(method in (None, "steady", "drive"), "method", method, "steady or drive")
    only_samples = not source.logs
    if method == "drive" and only_samples:
        raise LogError("holds steady samples, not traces: only method steady can be used")
    is_automatic = method is None and not only_samples
    is_steady = _are_steady_runs(source) if is_automatic else method != "drive"
    _refuse_unused_options(source, method, is_steady, sensor, lag)

    # 2. Any driving: laws are fitted to whole drives.
    if not is_steady:
        drive, refused = _from_whole_drives(source, sensor, None, step, lag)
        outliers = (*source.refused, *refused)
        return Identification(
            geometry=source.geometry,
            method="drive",
            steady=None,
            drive=drive,
            outliers=outliers,
            warnings=(*source.notes, *map(str, outliers), *drive.warnings),
            logs=source.logs,
        )

    # 3. Steady runs: laws are fitted to the mean slip of their stretches.
    steady = identify_samples(source.sampling, source.geometry, source.logs)
    if not is_automatic:
        return steady

    # 4. Then the whole drives are a cross-check, for which two laws are enough.
    step(1.0)
    try:
        cross_check, _ = _from_whole_drives(source, sensor, ("none", REFERENCE), step, lag)
    except LogError as error:
        warning = f"from whole drives nothing was identified: {error}"
        return replace(steady, warnings=(*steady.warnings, warning))
    return replace(steady, drive=cross_check)


def _from_whole_drives(
    source: Source,
    sensor: Mounting | None,
    names: Sequence[str] | None,
    step: Callable[[float], None],
    lag: bool,
) -> tuple[DriveComparison, list[Refused]]:
    """Laws by `names`, by default all with an answer, fitted to whole drives and compared; and the
    logs that were refused.
    """
    # clean drives: mean sprocket speeds in intervals, and the poses that were measured
    drives, refused = drives_of(source.logs)

    # is the log what it claims to be? clocks, sides, units; parts between jumps of the poses
    look = first_look(drives, source.geometry, sensor)

    # fits of laws in windows, the answer, and predictions of held-out driving
    return compare_drives(look, source.geometry, sensor, names, step, lag), refused


def _refuse_unused_options(
    source: Source, method: Method | None, is_steady: bool, sensor: Mounting | None, lag: bool
) -> None:
    """Raise InvalidValueError for options that the method, or the data, would ignore."""
    if not source.logs:
        reason = f"{source.name} holds steady samples, not traces"
        _refuse_traces_options(source.reading, reason)
        _refuse_drive_options(sensor, lag, reason)
    elif method == "steady":
        _refuse_drive_options(sensor, lag, "only method drive estimates it")
    elif method == "drive":
        _refuse_traces_options(source.reading, "only method steady uses it")
    elif not is_steady:
        reason = "most of the driving isn't steady, so whole drives are used; method steady uses it"
        _refuse_traces_options(source.reading, reason)


def _refuse_drive_options(sensor: Mounting | None, lag: bool, reason: str) -> None:
    """Raise InvalidValueError, with the `reason`, for options that only whole drives use."""
    require(sensor is None, "sensor", sensor, f"left out: {reason}")
    require(not lag, "lag", lag, f"left out: {reason}")


def _refuse_traces_options(reading: ReadOptions, reason: str) -> None:
    """Raise InvalidValueError, with the `reason`, for options that only steady stretches use."""
    require(reading.settle == SETTLE, "settle", reading.settle, f"left out: {reason}")
    require(reading.motion is None, "motion", reading.motion, f"left out: {reason}")


def identify_samples(
    sampling: Sampling, geometry: RobotGeometry, logs: tuple[RunLog, ...] = ()
) -> Identification:
    """Fit laws to steady samples and compare them; raises LogError if the samples determine no
    law.
    """
    steady = compare_laws(sampling.samples.along_robot(geometry), geometry)
    warnings = (*sampling.notes, *map(str, sampling.refused), *steady.warnings)
    return Identification(geometry, "steady", steady, None, sampling.refused, warnings, logs)


def _are_steady_runs(source: Source) -> bool:
    """True if runs are mostly steady, with one stretch each as in the paper's grid, and at least
    four can be used.
    """
    open_loop = [log for log in source.logs if "controller" not in log.metadata]
    if sum(map(turning_stretches, open_loop)) > len(source.logs):
        return False
    try:
        sampling = source.sampling
    except LogError:
        return False
    is_one_stretch_each = _FEWEST_RUNS <= len(sampling.samples) <= len(source.logs)
    return is_one_stretch_each and sampling.steady_share >= _STEADY_SHARE
