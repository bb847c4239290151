"""The paper from its grid to its last figure."""

import time
from typing import Any

from experiments.driving.grid_runs import cells_of
from experiments.driving.paper_model import published_runs
from experiments.driving.world import World
from experiments.measuring.grid import grid_summary, saturation_warnings, simulated_seconds
from experiments.measuring.paper_comparison import compare_with_paper
from experiments.measuring.sightings import sightings
from experiments.measuring.tracking import tracking_results
from experiments.options.reproduce import ReproduceConfig
from experiments.options.world import IDENTIFIED
from experiments.parallel.executors import Workers
from experiments.recording import record_all
from experiments.recording.failed_runs import results_or_failed_runs
from experiments.report.formats import stages_text
from experiments.report.reproduction import Report, comparison_table
from experiments.report.terminal import busy
from experiments.report.tracking import tracking_table
from experiments.reproducing.grid import driven_grid
from experiments.reproducing.grid_shares import GridShares
from experiments.reproducing.loops import Loops, start_poses
from experiments.storage.manifest import command_line
from experiments.storage.plain_json import plain
from experiments.storage.results import REPORT_FILE, write_results, write_runs
from sim.stopwatch import Stopwatch, timed
from trackslip.errors import RunFailedError
from trackslip.identification.comparison import fit_laws
from trackslip.identification.identify import identify_selected, select_samples
from trackslip.identification.result import identification_to_json
from trackslip.identification.samples import usable_samples
from trackslip.logs.runlog import RunLog
from trackslip.slip.exponential import PUBLISHED
from trackslip.trajectory.segmented import paper_reference


def reproduce(config: ReproduceConfig, workers: Workers, shares: GridShares, began: float) -> None:
    """Drive the grid, identify the laws, verify them in closed loop, store, report and print.

    While others drive, this process fits laws and draws figures. The times by stage are those of all workers together;
    `began` is when the command did, by `time.perf_counter`.
    """
    watch, world = Stopwatch(), World.of(config)
    with results_or_failed_runs(config.out, "reproduce", world) as folder:
        geometry = world.robot.geometry
        names = [cell.name for cell in cells_of(config)]
        with busy(f"{len(names)} runs, scans and poses"):
            driven = driven_grid(shares, watch)
        grid_logs = driven.logs
        with busy("slips and laws"):
            sampling = usable_samples(grid_logs, geometry, method=config.motion, longest=True, measured=driven.measured)
            with watch.stage("laws"):
                selected = select_samples(sampling, geometry)
                fitted = fit_laws(IDENTIFIED, selected.samples, geometry)
            loops = Loops(config, {name: one.law for name, one in fitted.items()}, workers)
            with watch.stage("laws"):
                found = identify_selected(selected, geometry, fitted=fitted)
            grid = grid_summary(config, names, grid_logs, sampling.samples, geometry, watch, driven.measured)
            published = workers.begin(timed, "report", published_runs, start_poses(), geometry)
        with busy("closed loops"):
            try:
                tracking_logs = loops.logs(watch, lambda: False)
            except RunFailedError as failure:
                failure.logs = [*grid_logs, *failure.logs]
                raise
        logs = [*grid_logs, *tracking_logs]
        tracking = tracking_results(tracking_logs, paper_reference())
        laws = {name: one.law for name, one in found.comparison.laws.items()}
        comparison = compare_with_paper(grid, laws, tracking)
        warnings = saturation_warnings(grid_logs)
        with busy("report"):
            beside, times = published()
            watch.add(times)
            write_runs(folder, logs)
            report = Report(
                command=command_line("reproduce"),
                manifest=world.manifest("reproduce", time.perf_counter() - began),
                comparison=comparison,
                radius=grid.radius,
                grid_logs=grid_logs,
                seen=sightings(grid_logs),
                identification=found,
                tracking=tracking,
                tracking_logs=tracking_logs,
                published=beside,
                warnings=warnings,
            )
            with watch.stage("report"):
                report.page().write(folder, config.pdf)
        wall, simulated = time.perf_counter() - began, simulated_seconds(logs)
        summary: dict[str, Any] = {
            **identification_to_json(found),
            "published": {
                "outer": {"alpha": PUBLISHED.alpha_outer, "beta": PUBLISHED.beta_outer},
                "inner": {"alpha": PUBLISHED.alpha_inner, "beta": PUBLISHED.beta_inner},
            },
            "warnings": [*warnings, *found.warnings],
            **grid.to_json(),
            "tracking": [result.to_json() for result in tracking],
            "timing": {"wall_s": wall, "simulated_s": simulated, "stages": watch.stages},
        }
        write_results(folder, plain(summary), report.manifest)
        if config.rrd:
            compared: dict[str, list[RunLog]] = {}
            for log in tracking_logs:
                compared.setdefault(f"{log.metadata['controller']} compared", []).append(log)
            with busy("recordings"):
                record_all(folder, logs, compared)
    comparison_table(comparison).print()
    tracking_table(tracking).print()
    for warning in summary["warnings"]:
        print(f"warning: {warning}")
    print(stages_text(watch.stages))
    print(f"{config.out / REPORT_FILE}: {wall:.1f} s for {simulated:.0f} s of simulated driving")
