"""RunLog: the record of a run, simulated or real, with a row for each scan, and the plate's returns
in the scans.
"""

from __future__ import annotations

import contextlib
import re
from collections.abc import Iterable, Sequence
from dataclasses import asdict, dataclass, field, replace
from itertools import pairwise
from typing import Any, Final

import numpy as np
from numpy.typing import ArrayLike

from trackslip.arguments import checks_arguments
from trackslip.errors import LogError, TrackslipError, counted
from trackslip.kinematics import Array, RobotGeometry
from trackslip.localization.scan import Cluster, Plate, Scan
from trackslip.logs.checks import LONGEST_STEP, gaps, unwrapped_headings
from trackslip.viewable import ShortRepr, Viewable

MALFORMED: Final = (
    TrackslipError,
    LookupError,
    TypeError,
    ValueError,
    AttributeError,
    OverflowError,
)
"""Errors that a run's metadata may cause if trackslip did not write them."""
_OPTIONAL: Final = (
    "command",
    "twist_command",
    "icr",
    "covariance",
    "valid",
    "load",
    "gyro",
    "truth",
    "scans",
)
_NUMBERS_AND_NAMES: Final = re.compile(r"'[^']*'|[-+]?\d[\d.,e+-]*")
MAX_YAW_RATE: Final = 100.0  # yaw rate above which a gyro reading is invalid [rad/s]
# least share of an interval with gyro readings for which the gyro's turn counts [-]
MEASURED: Final = 0.99


@dataclass(frozen=True, repr=False)
class Truth(ShortRepr):
    """Quantities that are known only in simulation."""

    pose: Array  # (T, 3) [m, m, rad]
    twist: Array  # (T, 3): forward speed, lateral speed to the left [m/s], yaw rate [rad/s]
    traction: Array | None = None  # (T, 2) force of the ground on each track, along the robot [N]
    torque: Array | None = None  # (T, 2) torque of each motor, at its sprocket [N m]
    # (T, 2) electrical power of each motor, mean since the previous row [W]
    power: Array | None = None
    # (T, 2) share of time since the previous row with the motor at its limit [-]
    saturated: Array | None = None
    sinkage: Array | None = None  # (T, 2) depth of the rut under each track, on soft soil [m]
    # (T, 2) force of the soil's compaction on each track, along the robot, on soft soil [N]
    resistance: Array | None = None
    lean: Array | None = None  # (T,) offset of the scanned plate to the left of the robot [m]
    # (T, P, 3) force of the ground on each pad: forwards, to the left, up [N]
    contact: Array | None = None
    # (T, P) shear displacement of the ground under each pad, for ground that shears [m]
    shear: Array | None = None


@dataclass(frozen=True, repr=False)
class ScanLog(ShortRepr):
    """The returns from the plate in each scan."""

    scan: Scan  # the scanner, without ranges: (0, B)
    plate: Plate  # the plate that was scanned
    cluster: Cluster  # a cluster per row of the log; it is empty where the plate was not found
    full: Array | None = None  # (T, B) all ranges of the scans, NaN for no return [m]

    @property
    def beam(self) -> np.ndarray:
        """Beam index (H,) of each return."""
        return np.rint((self.cluster.bearing - self.scan.bearings[0]) / self.scan.beam_step).astype(
            int
        )

    def between(self, first: int, end: int) -> ScanLog:
        """The scans from row `first` up to, but not including, `end`."""
        full = None if self.full is None else self.full[first:end]
        return replace(self, cluster=self.cluster.take(np.arange(first, end)), full=full)


@checks_arguments
@dataclass(frozen=True)
class RunLog(Viewable):
    """The log of a run. Row k has the measurements at time k and the command sent at that time."""

    run: str
    """Name of the run, unique within a file."""
    time: Array  # (T,) [s], ascending in steps of at most LONGEST_STEP
    omega: Array  # (T, 2) measured sprocket speeds, means since the previous reading [rad/s]
    # (T, 3) estimated pose [m, m, rad], phi unwrapped; NaN where positions or headings weren't
    # measured
    pose: Array
    command: Array | None = None  # (T, 2) commanded sprocket speeds [rad/s]
    twist_command: Array | None = None  # (T, 2) body twist commanded by a controller [m/s, rad/s]
    # (T, 2) D [m] and epsilon [-] of the constant ICRs used for slip compensation
    icr: Array | None = None
    covariance: Array | None = None  # (T, 3, 3) covariance of the pose
    # (T,) bool: true where the pose was measured; None if all poses were measured
    valid: np.ndarray | None = None
    # (T,) bool: true where the encoders were read; None if they were in every row. A row without a
    # reading has the speeds of the next reading, which are means over that row, too.
    read: np.ndarray | None = None
    # (T, 2) required traction per unit load, forwards and to the left [-]
    load: Array | None = None
    # (T,) yaw rate from a gyro, mean since the previous row [rad/s]; NaN where not measured
    gyro: Array | None = None
    truth: Truth | None = None
    scans: ScanLog | None = None  # T rows: the scans from which the poses were estimated
    # (B, 4) times and poses before the first and after the last encoder reading
    beyond: Array | None = None
    metadata: dict[str, Any] = field(default_factory=dict)
    """A JSON-compatible description of the run: geometry, ground, reference, controller, seed."""

    def __post_init__(self) -> None:
        rows = len(self.time)
        if rows < 2:
            raise LogError(f"run {self.run!r}: {counted(rows, 'row')}, needs at least 2")
        unknown = np.isnan(self.pose)
        # a position or heading alone counts as a pose
        halves = (unknown[:, 0] != unknown[:, 1]) | unknown.all(axis=1)
        wrong = {
            "time is not after the previous row": np.append(False, ~(np.diff(self.time) > 0)),
            "omega is not finite": ~np.isfinite(self.omega).all(axis=1),
            "pose is not finite": self.is_valid & (np.isinf(self.pose).any(axis=1) | halves),
        }
        for what, where in wrong.items():
            if where.any():
                raise LogError(f"run {self.run!r}: {what} in row {np.argmax(where) + 1}")
        for row in gaps(self.time, self.run)[:1]:
            before, after = self.time[row - 1 : row + 1]
            raise LogError(
                f"run {self.run!r}: no row from t = {before:.12g} s to {after:.12g} s: cut it into "
                f"drives, whose rows are at most {LONGEST_STEP:g} s apart"
            )

    @classmethod
    def from_arrays(
        cls,
        encoders: Sequence[ArrayLike],
        poses: Sequence[ArrayLike],
        gyro: Sequence[ArrayLike] | None = None,
        *,
        run: str = "run",
        geometry: RobotGeometry | None = None,
    ) -> RunLog:
        """Make the log of a drive from arrays, each sensor at times of its own.

        Args:
            encoders: times (N,) [s] and sprocket speeds (N,), left and right, means since the
                previous reading [rad/s]: `(t, omega_l, omega_r)`.
            poses: times (K,) [s], positions (K,) [m] and headings (K,), counter-clockwise [rad],
                NaN where not measured: `(t, x, y, phi)`, or `(t, x, y)` without headings.
            gyro: times (G,) [s] and yaw rates (G,), counter-clockwise, means since the previous
                reading [rad/s]: `(t, rate)`.
            run: name of the run.
            geometry: the robot's geometry, which `identify` then needn't be given.

        Times of all sensors are of one clock, or of clocks that differ by up to 2 s. The log has a
        row for each encoder reading and for each pose between the readings.

        Raises:
            LogError: for arrays of other shapes, times that don't ascend and readings that aren't
                finite; the message names the argument.
        """
        time, *omega = _sensor_arrays("encoders", encoders, (("t", "omega_l", "omega_r"),))
        usual = (("t", "x", "y", "phi"), ("t", "x", "y"))
        posed, *columns = _sensor_arrays("poses", poses, usual)
        pose = np.full((len(posed), 3), np.nan)
        pose[:, : len(columns)] = np.stack(columns, axis=-1)
        measured = np.isfinite(pose).any(axis=1)
        headed = np.isfinite(pose[:, 2])
        pose[headed, 2] = unwrapped_headings(pose[headed, 2])

        # a row for each reading of the encoders and each pose between them
        within = measured & (posed >= time[0]) & (posed <= time[-1])
        rows = np.union1d(time, posed[within])
        valid = np.isin(rows, posed[within])
        pose_of_row = np.full((len(rows), 3), np.nan)
        pose_of_row[valid] = pose[within]
        next_reading = np.searchsorted(time, rows)
        beyond = np.column_stack([posed, pose])[measured & ~within]

        rate = None
        if gyro is not None:
            read, yaw_rate = _sensor_arrays("gyro", gyro, (("t", "rate"),))
            rate = _mean_rates(rows, read, yaw_rate)
        return cls(
            run=run,
            time=rows,
            omega=np.stack(omega, axis=-1)[next_reading],
            pose=pose_of_row,
            valid=None if valid.all() else valid,
            read=None if len(rows) == len(time) else np.isin(rows, time),
            gyro=rate,
            beyond=beyond if len(beyond) else None,
            metadata={} if geometry is None else {"geometry": asdict(geometry)},
        )

    @property
    def is_valid(self) -> np.ndarray:
        """(T,) bool: true where the pose was measured."""
        return np.ones(len(self.time), bool) if self.valid is None else self.valid

    @property
    def is_read(self) -> np.ndarray:
        """(T,) bool: true where the encoders were read."""
        return np.ones(len(self.time), bool) if self.read is None else self.read

    @property
    def has_place(self) -> np.ndarray:
        """(T,) bool: true where the position was measured."""
        return self.is_valid & np.isfinite(self.pose[:, 0])

    @property
    def has_heading(self) -> np.ndarray:
        """(T,) bool: true where the heading was measured."""
        return self.is_valid & np.isfinite(self.pose[:, 2])

    def between(self, first: int, end: int) -> RunLog:
        """The rows from `first` up to, but not including, `end`."""
        if first == 0 and end == len(self.time):
            return self

        def part(log: RunLog | Truth) -> dict[str, Any]:
            return {
                name: value[first:end]
                for name, value in vars(log).items()
                if isinstance(value, np.ndarray)
            }

        truth = None if self.truth is None else replace(self.truth, **part(self.truth))
        scans = None if self.scans is None else self.scans.between(first, end)
        return replace(self, **part(self) | {"truth": truth, "scans": scans, "beyond": None})

    def cut(self, duration: float) -> list[RunLog]:
        """Cut the log into parts of equal duration, about `duration` [s] each; a shorter log is
        returned whole.
        """
        total = float(self.time[-1] - self.time[0])
        count = max(round(total / duration), 1)
        if count == 1:
            return [self]
        edges = self.time[0] + total * np.arange(count + 1) / count
        rows = np.searchsorted(self.time, edges).tolist()
        rows[-1] = len(self.time)
        parts = [self.between(first, end) for first, end in pairwise(rows) if end - first > 1]
        return [replace(part, run=f"{self.run} {k}") for k, part in enumerate(parts, start=1)]

    def __repr__(self) -> str:
        known = [name for name in _OPTIONAL if getattr(self, name) is not None]
        size = f"{len(self.time)} rows, {self.time[-1] - self.time[0]:.4g} s"
        return f"<RunLog {self.run!r}: {', '.join([size, *known])}>"


def _sensor_arrays(
    argument: str, arrays: Sequence[ArrayLike], usual: Sequence[tuple[str, ...]]
) -> list[Array]:
    """The arrays (n,) of a sensor, times first; `usual` are the names of arrays that it may have.

    Raises LogError, with the name of the argument, if the arrays are others, of different shapes or
    of no numbers, or times don't ascend or speeds aren't finite.
    """
    shown = " or ".join(f"({', '.join(names)})" for names in usual)
    counts = [len(names) for names in usual]
    try:
        given = [np.asarray(each, float) for each in arrays]
    except (TypeError, ValueError) as error:
        raise LogError(f"{argument}: must be arrays {shown} of numbers") from error
    if len(given) not in counts:
        columns = "; for the columns of a table give *table.T" if len(given) > max(counts) else ""
        raise LogError(f"{argument}: must be arrays {shown}, not {len(given)}{columns}")
    names = usual[counts.index(len(given))]
    time = given[0]
    for name, values in zip(names, given, strict=True):
        if values.ndim != 1 or values.shape != time.shape:
            raise LogError(
                f"{argument}: {name} has shape {values.shape}, must be (n,) like {names[0]}, which "
                f"has {time.shape}"
            )
    if not len(time):
        raise LogError(f"{argument}: has no rows")
    if not np.isfinite(time).all() or (np.diff(time) <= 0).any():
        raise LogError(f"{argument}: {names[0]} must be finite and ascend")
    if argument == "encoders":
        for name, values in zip(names, given, strict=True):
            if not np.isfinite(values).all():
                row = int(np.argmin(np.isfinite(values)))
                raise LogError(f"{argument}: {name}[{row}] is {values[row]}, must be finite")
    return given


def _mean_rates(rows: Array, time: Array, rate: Array) -> Array:
    """Yaw rates (T,) at `rows` (T,), means since the previous row, from readings (n,) at `time`
    (n,), means since the previous reading; NaN outside the readings and where one isn't finite.
    """
    known = np.isfinite(rate[1:])
    turn = np.append(0.0, np.cumsum(np.where(known, rate[1:], 0.0) * np.diff(time)))
    covered = np.append(0.0, np.cumsum(known * np.diff(time)))
    interval = np.diff(rows)
    mean = np.diff(np.interp(rows, time, turn)) / interval
    share = np.diff(np.interp(rows, time, covered)) / interval
    return np.append(np.nan, np.where(share >= MEASURED, mean, np.nan))


@dataclass(frozen=True)
class Refused:
    """A run that cannot be read, yields no sample or was excluded from the fits."""

    run: str  # name of the run, or of its steady stretch
    reason: str  # the reason for its exclusion

    @classmethod
    def of(cls, run: str, error: LogError) -> Refused:
        """Make a refusal from an error; the run's name is removed from the start of the message."""
        return cls(run, str(error).removeprefix(f"run {run!r}: "))

    def __str__(self) -> str:
        return f"run {self.run!r} left out: {self.reason}"


def none_usable(refused: Sequence[Refused]) -> str:
    """One line with the most frequent reason, for a log in which all runs are refused."""
    if len(refused) == 1:
        return f"run {refused[0].run!r}: {refused[0].reason}"
    return f"none of the {len(refused)} runs can be used; {in_few_lines(map(str, refused))[0]}"


def in_few_lines(lines: Iterable[str]) -> list[str]:
    """Group lines that differ only in numbers and quoted names; returns a line per group, the
    largest group first.
    """
    groups: dict[str, list[str]] = {}
    for line in dict.fromkeys(lines):
        groups.setdefault(_NUMBERS_AND_NAMES.sub("", line), []).append(line)
    ordered = sorted(groups.values(), key=len, reverse=True)
    return [
        first + (f" (and {len(others):,} more alike)" if others else "")
        for first, *others in ordered
    ]


def stored_geometry(log: RunLog) -> RobotGeometry | None:
    """The robot's geometry, if the log states it."""
    known = log.metadata.get("geometry")
    with contextlib.suppress(*MALFORMED):
        return (
            RobotGeometry(float(known["half_gauge"]), float(known["sprocket_radius"]))
            if known
            else None
        )
    return None
