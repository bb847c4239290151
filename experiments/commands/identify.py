"""`trackslip identify`: slip laws from a stored grid or from a real robot's log."""

from __future__ import annotations

import time
from functools import partial

from experiments.options.identify import IdentifyConfig
from experiments.report.formats import for_terminal
from experiments.report.identification import (
    CRITERIA_HEADER,
    LAW_HEADER,
    criteria_rows,
    criteria_table,
    law_rows,
    law_table,
)
from experiments.report.reproduction import Report, render
from experiments.report.terminal import print_table, progress
from experiments.storage.manifest import command_line, make_manifest
from experiments.storage.plain_json import write_json
from experiments.storage.results import (
    MANIFEST_FILE,
    REPORT_FILE,
    SUMMARY_FILE,
    results_folder,
    write_runs,
    write_samples,
)
from experiments.sweep.table import chosen
from trackslip.identification.identify import identified
from trackslip.identification.source import Reading, Source, origin, read_source
from trackslip.identification.summary import identification_to_json
from trackslip.slip.families import FAMILIES


def run(config: IdentifyConfig) -> None:
    """Fit the laws, store and print them."""
    began = time.perf_counter()
    with results_folder(config.out) as folder, progress("identification", 3, "stages") as report:
        source = source_of(config)
        report(1)
        found = identified(source)
        report(1)
        wall = time.perf_counter() - began
        timing = {"wall_s": wall, "stages": {"identify": wall}}
        manifest = make_manifest("identify", config, wall, **origin(source.logs))
        if source.logs:
            write_runs(folder, source.logs)
        else:
            write_samples(folder, source.sampling.samples)
        write_json(folder / SUMMARY_FILE, identification_to_json(found) | {"timing": timing})
        write_json(folder / MANIFEST_FILE, manifest)
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
    laws, criteria = law_table(law_rows(found.comparison)), criteria_table(criteria_rows(found))
    print_table(f"Slip laws from {len(found.samples)} runs", LAW_HEADER, for_terminal(laws))
    print_table("Laws compared, the best first", CRITERIA_HEADER, for_terminal(criteria))
    for warning in found.warnings:
        print(f"warning: {warning}")
    print(f"best: {best}, {FAMILIES[best].title}")
    print(f"{config.out / REPORT_FILE}: {time.perf_counter() - began:.1f} s")


def source_of(config: IdentifyConfig) -> Source:
    """The samples that the options select; raises LogError or InvalidValueError if none can be used."""
    reading = Reading(config.half_gauge, config.sprocket_radius, config.gear, config.settle, config.motion)
    return read_source(config.path, reading, partial(chosen, where=config.where) if config.where else None)
