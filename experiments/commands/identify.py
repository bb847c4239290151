"""`trackslip identify`: slip laws from a stored grid or from a real robot's log."""

import time
from functools import partial

from experiments.options.identify import IdentifyConfig
from experiments.report import identification as tables
from experiments.report.formats import for_terminal
from experiments.report.reproduction import Report, render
from experiments.report.terminal import print_table, progress
from experiments.storage.manifest import command_line, make_manifest
from experiments.storage.results import REPORT_FILE, results_folder, write_results, write_samples
from experiments.sweep.table import chosen
from trackslip.identification.identify import identify_samples
from trackslip.identification.result import identification_to_json
from trackslip.identification.source import Reading, Source, origin, read_source
from trackslip.slip.families import FAMILIES


def run(config: IdentifyConfig) -> None:
    """Fit the laws, store and print them."""
    began = time.perf_counter()
    with results_folder(config.out) as folder, progress("identification", 3, "stages") as report:
        source = source_of(config)
        report(1)
        found = identify_samples(source.sampling, source.geometry, source.logs)
        report(1)
        wall = time.perf_counter() - began
        timing = {"wall_s": wall, "stages": {"identify": wall}}
        manifest = make_manifest("identify", config, wall, **origin(source.logs))
        if not source.logs:
            write_samples(folder, source.sampling.samples)
        write_results(folder, identification_to_json(found) | {"timing": timing}, manifest, source.logs)
        page = Report(
            title=f"Slip laws identified from {config.path.name}",
            command=command_line("identify"),
            manifest=manifest,
            grid_logs=source.logs,
            identification=found,
        )
        render(page).write(folder, config.pdf)
        report(1)
    best = found.comparison.best
    laws = tables.law_table(tables.law_rows(found.comparison))
    criteria = tables.criteria_table(tables.criteria_rows(found))
    print_table(f"Slip laws from {len(found.samples)} runs", tables.LAW_HEADER, for_terminal(laws))
    print_table("Laws compared, the best first", tables.CRITERIA_HEADER, for_terminal(criteria))
    for warning in found.warnings:
        print(f"warning: {warning}")
    print(f"best: {best}, {FAMILIES[best].title}")
    print(f"{config.out / REPORT_FILE}: {time.perf_counter() - began:.1f} s")


def source_of(config: IdentifyConfig) -> Source:
    """The samples that the options select; raises LogError or InvalidValueError if none can be used."""
    reading = Reading(config.half_gauge, config.sprocket_radius, config.gear, config.settle, config.motion)
    return read_source(config.path, reading, partial(chosen, where=config.where) if config.where else None)
