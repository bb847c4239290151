"""`trackslip evaluate`: how far odometry by slip laws is off on a log."""

import contextlib
import json
import time
from collections.abc import Sequence
from dataclasses import asdict, replace
from functools import partial
from pathlib import Path

from experiments.measuring.error_table import write_error_table
from experiments.measuring.odometry import Evaluated, clock_doubt, evaluated, pose_doubts, summary_of
from experiments.options.evaluate import EvaluateConfig
from experiments.report.formats import for_terminal
from experiments.report.odometry import HEADERS, TITLES, gain, sensing_lines, tables
from experiments.report.terminal import print_table, progress
from experiments.storage.manifest import command_line, make_manifest, relative
from experiments.storage.results import (
    MANIFEST_FILE,
    REPORT_FILE,
    RUNS_FILE,
    SUMMARY_FILE,
    TABLE_FILE,
    TRAJECTORIES_FOLDER,
    arrow_errors,
    results_folder,
    write_results,
)
from experiments.sweep.table import chosen
from trackslip.errors import InvalidValueError, LogError
from trackslip.identification.source import Reading, Source, origin, read_source
from trackslip.kinematics import RobotGeometry
from trackslip.odometry.identified import LawInUse, identified_law, no_slip
from trackslip.odometry.mounting import Mounting
from trackslip.odometry.tum import write_tum
from trackslip.slip.families import FAMILIES
from trackslip.slip.stored_laws import NO_SLIP


def run(config: EvaluateConfig) -> None:
    """Evaluate the laws, store and print their errors."""
    began = time.perf_counter()
    specs = [_split(spec) for spec in config.law or (NO_SLIP,)]
    read = [path.resolve() for path in (config.path, *(path for path, _ in specs)) if path]
    if config.out.resolve() in [path.parent if path.name in (RUNS_FILE, SUMMARY_FILE) else path for path in read]:
        raise InvalidValueError("out", str(config.out), "another folder than those of the log and the laws")
    with results_folder(config.out) as folder, progress("odometry", 2 + len(specs), "stages") as step:
        source = _source(config, specs)
        for line in source.taken:
            print(line)
        laws = _laws(specs, source.geometry)
        step(1.0)
        sensor = None if config.sensor is None else Mounting(*config.sensor)
        found = evaluated(laws, source.logs, sensor, config.clock_offset, step)
        sensing = sensing_lines(found, config.sensor is not None, config.clock_offset is not None)
        notes = [*source.notes, *map(str, source.refused), *found[0].errors.notes, *_seen_before(config, specs)]
        notes += clock_doubt(found, source.logs) or pose_doubts(found)
        wall = time.perf_counter() - began
        manifest = make_manifest("evaluate", config, wall, **origin(source.logs))
        summary = {
            "geometry": asdict(source.geometry),
            "laws": {one.label: summary_of(one) for one in found},
            "drives": {one.label: one.errors.drives for one in found},
            "warnings": notes,
            "timing": {"wall_s": wall, "stages": {"evaluate": wall}},
        }
        write_results(folder, summary, manifest)
        with arrow_errors(folder / TABLE_FILE):
            write_error_table(found, folder / TABLE_FILE)
        if config.tum:
            _write_trajectories(found, folder / TRAJECTORIES_FOLDER)
        from experiments.report.odometry_page import render  # late: matplotlib

        name = config.path.name or str(config.path)
        render(found, notes, sensing, manifest, command_line("evaluate"), name).write(folder, config.pdf)
        step(1.0)
    _print(found, notes, sensing)
    print(f"{config.out / REPORT_FILE}: {time.perf_counter() - began:.1f} s")


def _split(spec: str) -> tuple[Path | None, str | None]:
    """File and name of a law; no file for none. Raises InvalidValueError for what is neither."""
    if spec == NO_SLIP:
        return None, NO_SLIP
    if Path(spec).exists():
        return Path(spec), None
    file, colon, name = spec.rpartition(":")
    if colon and name in FAMILIES and Path(file).exists():
        return Path(file), name
    allowed = f"{NO_SLIP}, or a folder or file with laws, and :NAME for one of {', '.join(FAMILIES)}"
    raise InvalidValueError("law", spec, allowed)


def _source(config: EvaluateConfig, specs: Sequence[tuple[Path | None, str | None]]) -> Source:
    """The drives; for a robot of the size that the laws were identified for, if the log does not state it."""
    select = partial(chosen, where=config.where) if config.where else None
    reading = Reading(config.half_gauge, config.sprocket_radius, config.gear, bag=config.bag.choice())
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


def _laws(specs: Sequence[tuple[Path | None, str | None]], robot: RobotGeometry) -> list[tuple[str, LawInUse]]:
    """The laws with their labels: their names, with the file where several have the same name."""
    laws = [no_slip(robot) if path is None else identified_law(path, name, robot) for path, name in specs]
    names = [one.name for one in laws]
    labels = [
        one.name if names.count(one.name) == 1 or path is None else f"{relative(str(path))}:{one.name}"
        for one, (path, _) in zip(laws, specs, strict=True)
    ]
    return list(zip(labels, laws, strict=True))


def _seen_before(config: EvaluateConfig, specs: Sequence[tuple[Path | None, str | None]]) -> list[str]:
    """Warnings about laws that were identified from this very log."""
    told = []
    for path, _ in specs:
        with contextlib.suppress(OSError, ValueError, KeyError, TypeError):
            about = json.loads((path / MANIFEST_FILE).read_text(encoding="utf-8")) if path is not None else {}
            if about["command"] == "identify" and Path(about["config"]["path"]).resolve() == config.path.resolve():
                told.append(f"{path}: identified from this log; on other driving its laws' errors may be larger")
    return list(dict.fromkeys(told))


def _write_trajectories(found: Sequence[Evaluated], folder: Path) -> None:
    """Write a file for each drive and law, and one for the measured poses."""
    from experiments.report.page import file_name  # late: matplotlib

    folder.mkdir()
    taken: set[str] = set()
    for k, drive in enumerate(found[0].errors.trajectories):
        name = file_name(drive.name) or "drive"
        name = f"{name}_{k + 1}" if name in taken else name
        taken.add(name)
        write_tum(folder / f"{name}_measured.tum", drive.time, drive.measured)
        for one in found:
            estimate = next(each for each in one.errors.trajectories if each.name == drive.name)
            write_tum(folder / f"{name}_{file_name(one.label)}.tum", estimate.time, estimate.placed)


def _print(found: Sequence[Evaluated], notes: Sequence[str], sensing: Sequence[str]) -> None:
    for key, rows in tables(found).items():
        print_table(TITLES[key], HEADERS[key], for_terminal(rows))
    for line in sensing:
        print(line)
    for note in notes:
        print(f"warning: {note}")
    if told := gain(found):
        print(told)
