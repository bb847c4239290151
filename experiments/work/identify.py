"""`trackslip identify`: slip laws from a stored grid or from a real robot's log."""

import time
from functools import partial

from experiments.options.identify import IdentifyConfig
from experiments.report import drives as drive_tables
from experiments.report import identification as steady_tables
from experiments.report.formats import for_terminal
from experiments.report.laws import law_table
from experiments.report.reproduction import Report, render
from experiments.report.terminal import print_table, progress
from experiments.storage.manifest import command_line, make_manifest
from experiments.storage.results import REPORT_FILE, results_folder, write_results, write_samples
from experiments.sweep.table import chosen
from trackslip.identification.drive.comparison import DriveComparison
from trackslip.identification.drive.estimate import DRIVE_LAWS
from trackslip.identification.identify import identify_source
from trackslip.identification.result import Identification, identification_to_json
from trackslip.identification.sensor import Sensor
from trackslip.identification.source import Reading, Source, origin, read_source
from trackslip.slip.families import FAMILIES

_STAGES = 3 + len(DRIVE_LAWS)  # reading, steady stretches, each law of whole drives, the report


def run(config: IdentifyConfig) -> None:
    """Fit the laws, store and print them."""
    began = time.perf_counter()
    with results_folder(config.out) as folder, progress("identification", _STAGES, "stages") as report:
        source = source_of(config)
        for line in source.taken:
            print(line)
        report(1)
        sensor = None if config.sensor is None else Sensor(*config.sensor)
        found = identify_source(source, config.method, sensor, config.estimate_sensor, report)
        wall = time.perf_counter() - began
        timing = {"wall_s": wall, "stages": {"identify": wall}}
        manifest = make_manifest("identify", config, wall, **origin(found.logs))
        if not found.logs:
            write_samples(folder, found.samples)
        write_results(folder, identification_to_json(found) | {"timing": timing}, manifest, found.logs)
        page = Report(
            title=f"Slip laws identified from {config.path.name}",
            command=command_line("identify"),
            manifest=manifest,
            grid_logs=found.logs,
            identification=found,
        )
        render(page).write(folder, config.pdf)
        report(1)
    _print(found)
    print(f"{config.out / REPORT_FILE}: {time.perf_counter() - began:.1f} s")


def source_of(config: IdentifyConfig) -> Source:
    """The runs and samples that the options select; raises LogError or InvalidValueError if none can be used."""
    reading = Reading(
        config.half_gauge, config.sprocket_radius, config.gear, config.settle, config.motion, config.bag.choice()
    )
    return read_source(config.path, reading, partial(chosen, where=config.where) if config.where else None)


def _print(found: Identification) -> None:
    """Print the laws by the chosen method in full, and those by the other one, if there are any, briefly."""
    if found.method == "drive" and found.drive is not None:
        _print_drive(found.drive)
        if found.steady is not None:
            _print_steady_laws(found)
    else:
        _print_steady_laws(found)
        criteria = steady_tables.criteria_table(steady_tables.criteria_rows(found))
        print_table("Laws compared, the best first", steady_tables.CRITERIA_HEADER, for_terminal(criteria))
        if found.drive is not None:
            _print_drive_laws(found.drive)
    for warning in found.warnings:
        print(f"warning: {warning}")
    print(f"best: {found.best}, {FAMILIES[found.best].title}")


def _print_steady_laws(found: Identification) -> None:
    laws = law_table(steady_tables.law_rows(found.comparison))
    print_table(f"Slip laws from {len(found.samples)} steady samples", steady_tables.LAW_HEADER, for_terminal(laws))


def _print_drive_laws(drive: DriveComparison) -> None:
    count = len(drive.drives)
    title = f"Slip laws from {'a whole drive' if count == 1 else f'{count} whole drives'}"
    laws = law_table(drive_tables.law_rows(drive))
    print_table(title, drive_tables.LAW_HEADER, for_terminal(laws))


def _print_drive(drive: DriveComparison) -> None:
    _print_drive_laws(drive)
    best = drive.laws[drive.best]
    extras = drive_tables.extra_table(drive_tables.extra_rows(best))
    print_table("Sensor and clock, by the best law", drive_tables.EXTRA_HEADER, for_terminal(extras))
    for line in drive_tables.held_lines(best):
        print(line)
    print()
    rows = drive_tables.prediction_rows(drive)
    position, heading = drive_tables.position_table(rows), drive_tables.heading_table(rows)
    print_table(
        "Held-out prediction of position, rms | median [m]", drive_tables.POSITION_HEADER, for_terminal(position)
    )
    if heading:
        print_table(
            "Held-out prediction of heading, rms | median [deg]", drive_tables.HEADING_HEADER, for_terminal(heading)
        )
