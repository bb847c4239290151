"""Runs and steady samples from any log: traces or samples, in a folder, a file, a bag or in
memory.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass, replace
from functools import cached_property, partial
from itertools import chain
from pathlib import Path
from typing import Any, Final

import numpy as np
import pyarrow as pa

from trackslip.bags.choice import AUTOMATIC, BagChoice
from trackslip.errors import InvalidValueError, LogError, counted, first_line, require_within
from trackslip.identification.misread_samples import refuse_misread
from trackslip.identification.samples import Sampling, SlipSamples, usable_samples
from trackslip.kinematics import GEARS, Array, RobotGeometry
from trackslip.logs.angles import EncoderKind
from trackslip.logs.columns import Columns
from trackslip.logs.layout import AS_DOCUMENTED, Layout
from trackslip.logs.logfile import read_tables, runs_file
from trackslip.logs.runlog import Refused, RunLog
from trackslip.logs.table import LATERAL, SAMPLE_COLUMNS
from trackslip.logs.table_reader import ReadRuns, RunsInTables, require_fitting
from trackslip.motion.steady import SETTLE

MULTIPLIERS: Final = (0.1, 10.0)
"""Least and largest wheel_separation_multiplier of a robot: the distance of its ICRs is within ten
times the gauge.
"""


@dataclass(frozen=True)
class ReadOptions:
    """Options for reading a log."""

    # half the distance between the tracks [m]; None to read it from the log
    half_gauge: float | None = None
    # radius of the sprockets [m]; None to read it from the log
    sprocket_radius: float | None = None
    # turns of the encoder per turn of the sprocket, if omega is the encoder's speed [-]
    gear: float = 1.0
    settle: float = SETTLE  # time skipped at the start of each steady stretch [s]
    # name of a motion method; None for the most accurate that each run allows
    motion: str | None = None
    bag: BagChoice = AUTOMATIC  # topics to read from bags
    # wheel_separation_multiplier of odometry that replaces encoders, if known [-]
    multiplier: float | None = None
    # names and units of a table's columns, ticks per turn, geometry of odometry
    layout: Layout = AS_DOCUMENTED
    # most memory for the content of the log [bytes]; None for half of the machine's memory
    max_memory: int | None = None

    def __post_init__(self) -> None:
        require_within("gear", self.gear, *GEARS)
        if self.multiplier is not None:
            require_within("multiplier", self.multiplier, *MULTIPLIERS)

    def layout_of(self, geometry: RobotGeometry | None) -> Layout:
        """The layout of a log of the robot with this `geometry`, if that is known."""
        return replace(self.layout, robot=geometry)

    @property
    def stated_geometry(self) -> RobotGeometry | None:
        """The robot's geometry, if the options state it."""
        if self.half_gauge is None or self.sprocket_radius is None:
            return None
        return RobotGeometry(self.half_gauge, self.sprocket_radius)

    @property
    def stated_multiplier(self) -> float | None:
        """wheel_separation_multiplier of odometry that replaces encoders: 1 if the options state
        the geometry that the odometry assumed.
        """
        if self.multiplier is None and self.layout.odometry is not None:
            return 1.0
        return self.multiplier

    def sprocket_speeds(self, omega: Array) -> Array:
        """Sprocket speeds (n, 2) from logged speeds (n, 2): of encoders, or from odometry with the
        multiplier.
        """
        mean = omega.mean(axis=1, keepdims=True)
        return (mean + (self.multiplier or 1.0) * (omega - mean)) / self.gear


@dataclass(frozen=True)
class Source:
    """Logged runs and their steady samples."""

    name: str  # name of the source in messages
    geometry: RobotGeometry
    reading: ReadOptions
    logs: tuple[RunLog, ...] = ()  # runs; empty if the log has samples instead of traces
    rows: Sampling | None = None  # samples, if the log has samples instead of traces
    refused: tuple[Refused, ...] = ()  # runs that cannot be read
    notes: tuple[str, ...] = ()  # parts of runs that were skipped while reading, a line for each
    taken: tuple[str, ...] = ()  # topics read from bags as encoders and poses, a line for each

    @cached_property
    def sampling(self) -> Sampling:
        """The log's samples, or samples from its runs without a controller; raises LogError if
        there are none.
        """
        if self.rows is not None:
            return self.rows
        steady = [log for log in self.logs if "controller" not in log.metadata]
        if not steady:
            number = counted(len(self.logs), "run")
            raise LogError(
                f"{self.name}: {number} in closed loop; slip is identified from steady runs"
            )
        with _naming(self.name):
            sampling = usable_samples(
                steady, self.geometry, self.reading.settle, self.reading.motion, self.refused
            )
        return replace(sampling, notes=(*self.notes, *sampling.notes))


def read_source(
    path: Path,
    reading: ReadOptions = ReadOptions(),
    chosen: Callable[[Path], Collection[str]] | None = None,
) -> Source:
    """Read runs or samples from a results folder, a `.parquet` or `.csv` file of traces or steady
    samples, or bags.

    `chosen` maps the folder to the names of the runs to use; None to use all runs. Raises LogError
    if nothing in the log can be read or `chosen` is given for a log without named runs,
    InvalidValueError if the geometry is unknown.
    """
    # late: runs in memory need no bags
    from trackslip.bags.drives import holds_bags, read_bags, refuse_choice

    is_bag = holds_bags(path)
    file = path if is_bag else runs_file(path)
    with _naming(file):
        if not is_bag:
            refuse_choice(path, reading.bag)
            return _of_table(file, reading, chosen)
        if chosen is not None:
            raise LogError("holds bags, not runs of a sweep: --where must be left out")
        geometry = _geometry(reading, None, path)  # before a long bag is read
        read = read_bags(path, reading.bag, reading.max_memory, reading.layout_of(geometry))
        return source_of_runs(read.runs, reading, str(path), read)


@contextmanager
def _naming(source: object) -> Iterator[None]:
    """Prefix the name of the source to any LogError whose message doesn't contain that name."""
    try:
        yield
    except LogError as error:
        raise error if str(source) in str(error) else LogError(f"{source}: {error}") from error


def source_of_runs(
    runs: Sequence[RunLog],
    reading: ReadOptions = ReadOptions(),
    name: str = "the runs",
    left_out: ReadRuns | None = None,
) -> Source:
    """Make a source from runs in memory; messages call it `name`. `left_out` has notes and refused
    runs from reading.

    Raises LogError if there are no runs or if runs differ in something that affects slip,
    InvalidValueError if neither `reading` nor the runs state the geometry.
    """
    if not runs:
        raise LogError(f"{name}: there are none")
    left_out = left_out or ReadRuns()
    notes = (*left_out.notes, *_require_one_setting(runs, name))
    geometry = _geometry(reading, runs[0].metadata.get("geometry"), name)
    known = {"geometry": asdict(geometry), "multiplier": reading.stated_multiplier}
    known = {key: value for key, value in known.items() if value is not None}
    logs = tuple(
        replace(log, omega=reading.sprocket_speeds(log.omega), metadata=log.metadata | known)
        for log in runs
    )
    return Source(
        name, geometry, reading, logs, refused=left_out.refused, notes=notes, taken=left_out.taken
    )


def source_of_frame(frame: object, reading: ReadOptions = ReadOptions()) -> Source:
    """Make a source from a data frame in memory with the columns of a log: of pandas, Polars,
    PyArrow, or any other library with Arrow's protocol `__arrow_c_stream__`.

    Raises LogError if nothing in it can be read, InvalidValueError if the geometry is unknown.
    """
    name = f"the {type(frame).__name__}"
    with _naming(name):
        try:
            table = pa.table(frame)
        except (pa.ArrowException, TypeError, ValueError) as error:
            raise LogError(f"can't be read as a table ({first_line(error)})") from error
        return _of_tables(iter([table]), name, reading)


def _of_table(
    file: Path, reading: ReadOptions, chosen: Callable[[Path], Collection[str]] | None
) -> Source:
    """Read the runs or the steady samples in a file."""
    names = None if chosen is None else partial(chosen, file.parent)
    return _of_tables(read_tables(file, reading.max_memory), str(file), reading, names)


def _of_tables(
    tables: Iterator[pa.Table],
    name: str,
    reading: ReadOptions,
    chosen: Callable[[], Collection[str]] | None = None,
) -> Source:
    """Read the runs or the steady samples in successive parts of a table called `name`; `chosen`
    returns the names of the runs to use, None to use all.
    """
    layout = reading.layout_of(reading.stated_geometry)
    first = next(tables)
    columns = layout.applied(first, name).column_names
    if "x" not in columns and set(SAMPLE_COLUMNS) <= set(columns):
        if chosen is not None:
            raise LogError("holds steady samples, not runs of a sweep: --where must be left out")
        require_fitting(layout, EncoderKind.SPEEDS, name)
        geometry = _geometry(reading, None, name)
        samples = [layout.applied(table, name) for table in (first, *tables)]
        cells = Columns(pa.concat_tables(samples), name)
        return Source(name, geometry, reading, rows=_sampled(cells, reading, geometry))
    read = RunsInTables(chain([first], tables), name, reading.max_memory, layout).read()
    runs = list(read.runs)
    if chosen is not None:
        names = chosen()
        runs = [log for log in runs if log.run in names]
        if not runs:
            raise LogError(f"the chosen {counted(len(names), 'run')} failed")
    return source_of_runs(runs, reading, name, read)


def _sampled(columns: Columns, reading: ReadOptions, geometry: RobotGeometry) -> Sampling:
    """The usable rows in a table of steady samples, as samples named row 1, row 2, and so on."""
    columns.require(SAMPLE_COLUMNS)
    values = np.stack([columns.cells(name).values for name in SAMPLE_COLUMNS], axis=-1)
    if not len(values):
        raise LogError("no rows")
    omega = reading.sprocket_speeds(values[:, :2])
    # a wrong unit is wrong in all rows: before single rows are left out
    whole = np.flatnonzero(np.isfinite(values).all(axis=1))
    refuse_misread(omega[whole], values[whole, 2:], geometry, whole.tolist())
    lateral = columns.optional((LATERAL,))
    refused = list[Refused]()
    usable = list[SlipSamples]()
    for k, row in enumerate(values):
        name = f"row {k + 1}"
        left = None if lateral is None else lateral[[k], 0]
        try:
            for column in np.flatnonzero(np.isnan(row)):
                raise LogError(
                    columns.complaint(SAMPLE_COLUMNS[column], k).removeprefix(f"{name}, ")
                )
            usable.append(SlipSamples.of(omega[[k]], row[None, 2:], geometry, [name], lateral=left))
        except LogError as error:
            refused.append(Refused.of(name, error))
    return Sampling.of(usable, refused)


def _require_one_setting(logs: Sequence[RunLog], source: str) -> tuple[str, ...]:
    """Note a difference in load between runs; raises LogError if ground or robot differ, so that no
    law fits all.
    """
    for key in ("ground", "radius_error", "geometry", "model_sha256"):
        first, *others = [log.metadata[key] for log in logs if key in log.metadata] or [None]
        if all(other == first for other in others):
            continue
        names = []
        if all(isinstance(setting, Mapping) for setting in (first, *others)):
            names = [
                name for name in first if any(other.get(name) != first[name] for other in others)
            ]
        differing = f"its runs differ in {key}" + (f" ({', '.join(names)})" if names else "")
        if (
            not names
            or not set(names) <= {"slope", "uphill"}
            or any(log.load is None for log in logs)
        ):
            raise LogError(f"{source}: {differing}: choose with --where NAME=VALUE")
        return (f"{differing}: only icr_load takes that into account",)
    return ()


def _geometry(reading: ReadOptions, stored: Any, source: object) -> RobotGeometry:
    """The geometry from `reading` or, where that is None, from the log (`stored`);
    InvalidValueError if unknown.
    """
    values = {}
    for name in ("half_gauge", "sprocket_radius"):
        given = getattr(reading, name)
        value = stored.get(name) if given is None and isinstance(stored, Mapping) else given
        if isinstance(value, bool) or not isinstance(value, int | float):
            option = f"--{name.replace('_', '-')}"
            raise InvalidValueError(
                name, value, f"given ({option} on the command line): {source} does not state it"
            )
        values[name] = float(value)
    return RobotGeometry(**values)
