"""Odometry by several laws on the same log: the drives, the laws, their errors and the files of both."""

from __future__ import annotations

import contextlib
import json
import os
from collections.abc import Callable, Collection, Iterator, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.parquet

from experiments.common.manifest import relative
from experiments.common.results import MANIFEST_FILE, RUNS_FILE, SUMMARY_FILE, file_names
from experiments.evaluate.config import Config
from trackslip.errors import InvalidValueError, LogError, counted
from trackslip.identification.source import ReadOptions, Source, read_source
from trackslip.kinematics import RobotGeometry
from trackslip.logs.runlog import RunLog
from trackslip.logs.schema import NO_UNIT, PURE, Column
from trackslip.odometry.checks import better_clock_offset, jumps
from trackslip.odometry.evaluation import OdometryErrors, PoseErrors, odometry_errors
from trackslip.odometry.identified import LawInUse, identified_law, no_slip
from trackslip.odometry.slip_odometry import SlipOdometry
from trackslip.odometry.tum import write_tum
from trackslip.odometry.uncertainty import Gyro
from trackslip.se2 import Mounting
from trackslip.slip.families import FAMILIES, RETIRED
from trackslip.slip.law_file import NO_SLIP

LawFile = tuple[Path | None, str | None]
"""A file with laws and the name of one; no file for odometry without slip."""
_KINDS = ("rms", "mean", "median", "largest")
COLUMNS = (
    Column("law", NO_UNIT, "label of the law"),
    Column("kind", NO_UNIT, "aligned or from_first (absolute), metres or seconds (relative)"),
    Column("length", NO_UNIT, "length of the stretches, in m or s"),
    Column("count", PURE, "number of stretches"),
    *(Column(f"position_{kind}", "m", f"{kind} error of position") for kind in _KINDS),
    *(Column(f"heading_{kind}", "rad", f"{kind} error of heading") for kind in _KINDS),
    Column("position_per_way", PURE, "sum of the errors of position over that of the ways driven"),
    Column("heading_per_way", "rad/m", "sum of the errors of heading over that of the ways driven"),
)
"""Columns of the table; empty where there is nothing."""
_TEXTS = ("law", "kind")
_MANY = 0.005  # share of outlying poses that is told


@dataclass(frozen=True)
class Evaluated:
    """A law and the errors of odometry by it."""

    label: str  # the law's name, with its file where others have the same name
    used: LawInUse
    mounting: Mounting  # of the sensor that measured the poses
    clock_offset: float  # encoder clock minus pose clock [s]
    errors: OdometryErrors


def evaluated(
    laws: Sequence[tuple[str, LawInUse]],
    logs: Sequence[RunLog],
    mounting: Mounting | None = None,
    clock_offset: float | None = None,
    step: Callable[[float], None] = lambda _: None,
) -> list[Evaluated]:
    """Errors of laws, by their labels, on the same logs; `step(1.0)` is called after each law.

    Unless given, sensor and clock are as identified with each law, for laws shift and turn them differently; for laws
    that come without, as with the first law that has them. If a log has a gyro, the best law comes once more, with it,
    as the last. Raises LogError if no log has poses to compare with.
    """
    first = next((used for _, used in laws if used.mounting is not None), None)
    found = []
    for label, used in laws:
        known = first if used.mounting is None else used
        place = mounting or (known.mounting if known else None) or Mounting()
        offset = ((known.clock_offset if known else None) or 0.0) if clock_offset is None else clock_offset
        used = replace(used, gyro=None)
        found.append(Evaluated(label, used, place, offset, odometry_errors(logs, _odometry(used), place, offset)))
        step(1.0)
    if any(log.gyro is not None for log in logs):
        best = min(found, key=_misfit)
        used = replace(best.used, gyro=dict(laws)[best.label].gyro or Gyro())
        errors = odometry_errors(logs, _odometry(used), best.mounting, best.clock_offset)
        found.append(replace(best, label=f"{best.label} with gyro", used=used, errors=errors))
    return found


def _misfit(one: Evaluated) -> float:
    """Median error of position after the longest time [m]."""
    ahead = [*one.errors.after_seconds.values()]
    return ahead[-1].position.median if ahead and ahead[-1].position else float("inf")


def clock_doubt(found: Sequence[Evaluated], logs: Sequence[RunLog]) -> list[str]:
    """A line if another offset between the clocks fits clearly better."""
    one = next((one for one in found if one.used.name != NO_SLIP), found[0])
    better = better_clock_offset(logs, _odometry(one.used), one.mounting, one.clock_offset)
    if better is None:
        return []
    told = f"{clock_words(better)}, not {clock_words(one.clock_offset)}"
    return [f"the encoders' clock seems to be {told}: try --clock-offset {round(better, 3) + 0.0:.3f}"]


def clock_words(offset: float) -> str:
    """Where the encoders' clock is for an offset, encoder clock minus pose clock [s]."""
    milliseconds = round(1e3 * offset)
    return f"{abs(milliseconds)} ms {'behind' if milliseconds < 0 else 'ahead of'} the poses'"


def pose_doubts(found: Sequence[Evaluated]) -> list[str]:
    """A line for each drive whose measured poses jump away and back, or lastingly, by the law that fits them best."""

    def misfit(one: Evaluated) -> float:
        position = one.errors.aligned.position
        return float("inf") if position is None else position.median

    doubts = []
    for drive in min(found, key=misfit).errors.trajectories:
        outlying, lasting = jumps(drive)
        what = [counted(outlying, "outlying pose")] if outlying > _MANY * len(drive.time) else []
        what += [f"{counted(lasting, 'lasting jump')} of the poses"] if lasting else []
        if what:
            told = f"run {drive.name!r}: {' and '.join(what)} count in all errors"
            doubts.append(f"{told}; medians tell more of the law")
    return doubts


def summary_of(one: Evaluated) -> dict[str, Any]:
    """A law and its errors as content of a summary.json."""
    errors = one.errors
    return {
        "law": one.used.name,
        "sensor": one.mounting,
        "clock_offset": one.clock_offset,
        "aligned": errors.aligned,
        "from_first": errors.from_first,
        "after_metres": {f"{length:g}": found for length, found in errors.after_metres.items()},
        "after_seconds": {f"{length:g}": found for length, found in errors.after_seconds.items()},
    }


def _odometry(used: LawInUse) -> SlipOdometry:
    """Odometry without the errors of the law, which take longer."""
    return SlipOdometry(used.law, used.geometry, used.noise, drift=used.drift, gyro=used.gyro)


def law_files(config: Config) -> list[LawFile]:
    """The laws that the options name; raises InvalidValueError for others, and for results that would replace them."""
    specs = [_law_file(spec) for spec in config.law or (NO_SLIP,)]
    out, *read = [Path(os.path.realpath(path)) for path in (config.out, config.path, *(p for p, _ in specs)) if path]
    if out in [path.parent if path.name in (RUNS_FILE, SUMMARY_FILE) else path for path in read]:
        raise InvalidValueError("out", str(config.out), "another folder than those of the log and the laws")
    return specs


def _law_file(spec: str) -> LawFile:
    """File and name of a law; no file for none. Raises InvalidValueError for what is neither."""
    file, _, name = spec.rpartition(":")
    if spec == NO_SLIP:
        return None, NO_SLIP
    if os.path.exists(spec):  # unlike Path.exists, also False for names that are too long
        return Path(spec), None
    if file and (name in FAMILIES or name in RETIRED) and os.path.exists(file):
        return Path(file), name
    allowed = f"{NO_SLIP}, or a folder or file with laws, and :NAME for one of {', '.join(FAMILIES)}"
    raise InvalidValueError("law", spec, allowed)


def read_drives(config: Config, specs: Sequence[LawFile], select: Callable[[Path], Collection[str]] | None) -> Source:
    """The drives; for a robot of the size that the laws were identified for, if the log does not state it."""
    reading = ReadOptions(config.half_gauge, config.sprocket_radius, config.gear, bag=config.bag.choice())
    known = next((identified_law(path, name).geometry for path, name in specs if path is not None), None)
    try:
        source = read_source(config.path, reading, select)
    except InvalidValueError as error:
        if known is None or error.field not in asdict(known) or error.value is not None:
            raise
        b, r = config.half_gauge or known.half_gauge, config.sprocket_radius or known.sprocket_radius
        source = read_source(config.path, replace(reading, half_gauge=b, sprocket_radius=r), select)
    if not source.logs:
        raise LogError(f"{source.name}: holds steady samples; odometry needs drives with times and poses")
    return source


def labelled_laws(specs: Sequence[LawFile], robot: RobotGeometry) -> list[tuple[str, LawInUse]]:
    """The laws with their labels: their names, with the file where several have the same name."""
    laws = [no_slip(robot) if path is None else identified_law(path, name, robot) for path, name in specs]
    names = [one.name for one in laws]
    labels = [
        one.name if names.count(one.name) == 1 or path is None else f"{relative(str(path))}:{one.name}"
        for one, (path, _) in zip(laws, specs, strict=True)
    ]
    return list(zip(labels, laws, strict=True))


def identified_from(log: Path, specs: Sequence[LawFile]) -> list[str]:
    """Warnings about laws that were identified from this very log."""
    told = []
    for path, _ in specs:
        with contextlib.suppress(OSError, ValueError, KeyError, TypeError):
            about = json.loads((path / MANIFEST_FILE).read_text(encoding="utf-8")) if path is not None else {}
            if about["command"] == "identify" and os.path.realpath(about["config"]["path"]) == os.path.realpath(log):
                told.append(f"{path}: identified from this log; on other driving its laws' errors may be larger")
    return list(dict.fromkeys(told))


def write_trajectories(found: Sequence[Evaluated], folder: Path) -> None:
    """Write a file for each drive and law, and one for the measured poses."""
    folder.mkdir()
    drives = found[0].errors.trajectories
    labels = file_names([one.label for one in found])
    for drive, name in zip(drives, file_names([drive.name for drive in drives]), strict=True):
        write_tum(folder / f"{name}_measured.tum", drive.time, drive.measured)
        for one, label in zip(found, labels, strict=True):
            estimate = next(each for each in one.errors.trajectories if each.name == drive.name)
            write_tum(folder / f"{name}_{label}.tum", estimate.time, estimate.placed)


def write_error_table(found: Sequence[Evaluated], path: Path) -> None:
    """Write the errors of laws to a Parquet file, with units and meanings in the columns' metadata."""
    kinds = [pa.string() if column.name in _TEXTS else pa.float64() for column in COLUMNS]
    fields = [pa.field(one.name, kind, metadata=one.metadata) for one, kind in zip(COLUMNS, kinds, strict=True)]
    table = pa.Table.from_pylist([row for one in found for row in _rows(one)], pa.schema(fields))
    pa.parquet.write_table(table, path, write_page_checksum=True)


def _rows(one: Evaluated) -> Iterator[dict[str, Any]]:
    errors = one.errors
    for kind, absolute in (("aligned", errors.aligned), ("from_first", errors.from_first)):
        yield {"law": one.label, "kind": kind} | _statistics(absolute)
    for kind, by_length in (("metres", errors.after_metres), ("seconds", errors.after_seconds)):
        for length, ahead in by_length.items():
            ratios = {name: getattr(ahead, name) for name in ("position_per_way", "heading_per_way")}
            about = {"law": one.label, "kind": kind, "length": length, "count": ahead.count}
            yield about | _statistics(ahead) | {key: value for key, value in ratios.items() if value == value}


def _statistics(errors: PoseErrors) -> dict[str, float]:
    parts = (("position", errors.position), ("heading", errors.heading))
    return {f"{name}_{kind}": getattr(part, kind) for name, part in parts if part is not None for kind in _KINDS}
