"""`trackslip log`: show what a log contains, and write it as a table."""

import csv
import shlex
from collections.abc import Iterable, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from math import degrees
from pathlib import Path
from typing import Annotated, ClassVar, Final

import numpy as np
import tyro

from experiments.common.log_options import (
    Bag,
    BagOptions,
    LayoutOptions,
    MaxMemory,
    TableLayout,
    size_in_bytes,
)
from experiments.common.options import Exclusion, Needs, Options, default_is
from experiments.common.results import RUNS_FILE, write_outputs
from experiments.common.table import MISSING, Table, number
from trackslip.bags.choice import BagChoice
from trackslip.bags.drives import holds_bags, read_runs_of, runs_of
from trackslip.bags.open import Bag as RosBag
from trackslip.bags.open import open_bags
from trackslip.bags.topics import (
    IMU,
    LASER_SCAN,
    encoder_topics,
    imu_topic,
    pose_source,
    pose_sources,
    scan_topic,
)
from trackslip.errors import InvalidValueError, LogError, counted
from trackslip.logs.logfile import write_csv, write_parquet
from trackslip.logs.runlog import RunLog, stored_geometry
from trackslip.logs.schema import COLUMNS
from trackslip.logs.table import column_names
from trackslip.logs.table_reader import ReadRuns

EXAMPLES: Final = (
    ("a bag's topics, and the log that identify would read", "trackslip log run.mcap"),
    (
        "the same with other poses, as a table",
        "trackslip log old.bag --poses tf:map:base_link --out log.parquet",
    ),
    ("stored runs for a spreadsheet", "trackslip log out/grid --out grid.csv"),
    (
        "poses of a plate in the scans of a laser range finder",
        "trackslip log run.mcap --plate 0.5x0.02 --out log.csv",
    ),
)
ESSENTIAL: Final = (
    "path",
    "out",
    "overwrite",
    "bag.encoders",
    "bag.poses",
    "bag.imu",
    "bag.plate",
    "table.columns",
)
_TOPICS: Final = ("topic", "type", "messages", "rate [Hz]", "longest gap [s]", "use (*: taken)")
_RUNS: Final = (
    "run",
    "rows",
    "duration [s]",
    "longest step [s]",
    "poses",
    "rate [Hz]",
    "longest gap [s]",
)
_FORMATS: Final = (".parquet", ".csv")


@dataclass(frozen=True)
class Config(Options):
    """Show what a results folder, a table of runs or a ROS bag contains; with --out, write the runs
    as a table.
    """

    path: Annotated[Path, tyro.conf.Positional, tyro.conf.arg(metavar="PATH")]
    """Results folder, .parquet or .csv log, or ROS bag (.bag, .mcap, .db3, or a folder of them)."""
    bag: Bag = field(default_factory=BagOptions)
    """Topics to read from a bag."""
    table: TableLayout = field(default_factory=LayoutOptions)
    """Names and units of a table's columns."""
    max_memory: MaxMemory = None
    """Most memory for what the log unpacks to, such as 8GB; a log that needs more is refused."""
    out: Annotated[Path | None, default_is("none", "FILE")] = None
    """Write the runs to this .parquet or .csv file; a .csv comes with NAME.columns.csv, which
    states the units.
    """
    overwrite: Annotated[bool, tyro.conf.FlagCreatePairsOff] = False
    """Replace the file if it exists; needs --out."""

    exclusions: ClassVar[tuple[Exclusion, ...]] = (Needs(("overwrite",), "out"),)

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.out is None:
            return
        if self.out.suffix.lower() not in _FORMATS:
            raise InvalidValueError("out", self.out, f"a file that ends in {' or '.join(_FORMATS)}")
        if self.out.resolve() in (self.path.resolve(), (self.path / RUNS_FILE).resolve()):
            raise InvalidValueError("out", self.out, "a file other than the one being read")


def run(config: Config) -> None:
    """Print what the log contains, or write it as a table."""
    choice = config.bag.choice()
    layout = config.table.layout()
    max_memory = size_in_bytes("max_memory", config.max_memory)
    if config.out is not None:
        read_runs = read_runs_of(config.path, choice, max_memory, layout)
        _write(read_runs, choice, config.out, config.overwrite)
        return
    bags = open_bags(config.path, max_memory) if holds_bags(config.path) else []
    damage = [note for bag in bags for note in bag.notes]
    for bag in bags:
        _topics_table(bag, choice).print()
    columns: dict[str, None] = {}
    runs: list[Sequence[str]] = []
    scanners: list[str] = []
    try:
        read = runs_of(config.path, choice, max_memory, layout)
        for log in read:
            columns |= dict.fromkeys(column_names(log))
            runs.append(_cells(log))
            scanners += _scanner_lines(log, choice)
    except LogError as error:
        if not bags:
            raise
        _print_warnings((*damage, str(error)))  # the printed topics show what options can select
        return
    _columns_table(columns).print()
    Table(f"Runs in {config.path}", _RUNS, runs).print()
    for line in (*read.taken, *scanners):
        print(line)
    _print_warnings((*damage, *read.warnings))


def _topics_table(bag: RosBag, choice: BagChoice) -> Table:
    used = _uses(bag, choice)
    arrivals = bag.arrivals()
    rows = []
    for name, topic in bag.topics.items():
        kind = topic.type.replace("/msg/", "/")
        rate, longest = _rate_and_gap(arrivals[name])
        row = (name, kind, str(topic.count), number(rate, 1), number(longest, 2))
        rows.append((*row, used.get(name, "")))
    frames = [name for name in used if name not in bag.topics]
    rows += [(name, "transforms", MISSING, MISSING, MISSING, used[name]) for name in frames]
    recorded = np.concatenate(list(arrivals.values()))
    duration = f"{np.ptp(recorded) / 1e9:.1f} s" if len(recorded) else "no messages"
    return Table(f"{bag.path}: {duration}", _TOPICS, rows, "llrrrl")


def _rate_and_gap(arrivals: np.ndarray) -> tuple[float, float]:
    """Usual rate [Hz] and longest gap [s] between arrivals (n,) [ns]; NaN for less than two."""
    gaps = np.diff(arrivals) / 1e9
    if not gaps.size:
        return np.nan, np.nan
    usual = float(np.median(gaps))
    rate = 1 / usual if usual else np.nan
    return rate, float(gaps.max())


def _uses(bag: RosBag, choice: BagChoice) -> dict[str, str]:
    """Possible uses of a bag's topics and frames (tf:PARENT:CHILD), by name; a star marks what
    `choice` selects.
    """
    found: dict[str, str] = {topic.name: "scans, for --plate" for topic in bag.of_type(LASER_SCAN)}
    found |= {source.name: f"poses: {source.origin.value}" for source in pose_sources(bag)}
    found |= {topic.name: "gyro" for topic in bag.of_type(IMU)}
    with suppress(LogError):
        found |= dict.fromkeys(
            (topic.name for topic in encoder_topics(bag, choice)[0]), "* encoders"
        )
    with suppress(LogError):
        if choice.plate is not None:
            found[scan_topic(bag, choice.scan).name] = "* scans of the plate"
            return found
        source = pose_source(bag, choice)
        found[source.name] = f"* {found.get(source.name, 'poses')}"
        imu = imu_topic(bag, choice)
        if imu is not None:
            found[imu.name] = "* gyro, headings" if source.name == imu.name else "* gyro"
    return found


def _columns_table(names: Iterable[str]) -> Table:
    columns = [COLUMNS[name] for name in names]
    rows = [(column.name, column.unit or MISSING, column.description) for column in columns]
    return Table("Columns", ("column", "unit", "description"), rows, "l")


def _cells(log: RunLog) -> tuple[str, ...]:
    """The row of a run in the table of runs, with the columns _RUNS."""
    posed = log.time[log.is_valid]
    gaps = np.diff(posed) if len(posed) > 1 else np.array([np.nan])
    return (
        log.run,
        str(len(log.time)),
        number(float(log.time[-1] - log.time[0]), 2),
        number(float(np.diff(log.time).max()), 2),
        str(len(posed)),
        number(1 / float(np.median(gaps)), 1),
        number(float(gaps.max()), 2),
    )


def _scanner_lines(log: RunLog, choice: BagChoice) -> list[str]:
    """A line with the estimated pose and noise of the scanner, if a plate was followed in scans."""
    if choice.plate is None or log.scans is None:
        return []
    x, y, yaw = log.scans.scan.mount
    place = f"x = {x:.3f} m, y = {y:.3f} m, yaw = {degrees(yaw):.2f}°"
    noise = f"{1e3 * log.scans.scan.noise:.1f} mm"
    return [f"{log.run}: scanner at {place}, noise {noise}"]


def _print_warnings(lines: Sequence[str]) -> None:
    for line in dict.fromkeys(lines):
        print(f"warning: {line}")


def _write(read: ReadRuns, choice: BagChoice, file: Path, overwrite: bool) -> None:
    """Write the runs to `file`, and for CSV also a file with units."""
    parquet = file.suffix.lower() == ".parquet"
    units = file.with_suffix(".columns.csv")
    columns: list[str] = []

    def write_numbers(draft: Path) -> None:
        write_csv(read.runs, draft)
        columns.extend(_header(draft))

    if parquet:
        write_outputs({file: lambda draft: write_parquet(read.runs, draft)}, overwrite)
    else:
        write_outputs(
            {file: write_numbers, units: lambda draft: _write_units(columns, draft)}, overwrite
        )

    for line in read.taken:
        print(line)
    for log in read.runs:
        for line in _scanner_lines(log, choice):
            print(line)
    _print_warnings(read.warnings)
    rows = sum(len(log.time) for log in read.runs)
    size = f"{counted(len(read.runs), 'run')}, {counted(rows, 'row')}"
    print(f"{file}: {size}" if parquet else f"{file}: {size}; units in {units.name}")

    robot = stored_geometry(read.runs[0])
    half_gauge = "…" if robot is None else f"{robot.half_gauge:g}"
    radius = "…" if robot is None else f"{robot.sprocket_radius:g}"
    sizes = f"--half-gauge {half_gauge} --sprocket-radius {radius}"
    print(f"trackslip identify {shlex.quote(str(file))} {sizes}")


def _header(table: Path) -> list[str]:
    """The names of the columns of a CSV file."""
    with table.open(newline="", encoding="utf-8") as text:
        return next(csv.reader(text))


def _write_units(names: Iterable[str], file: Path) -> None:
    """Write the unit and description of each column to the CSV file `file`."""
    with file.open("w", newline="", encoding="utf-8") as text:
        writer = csv.writer(text)
        writer.writerow(("column", "unit", "description"))
        for name in names:
            column = COLUMNS[name]
            writer.writerow((column.name, column.unit, column.description))
