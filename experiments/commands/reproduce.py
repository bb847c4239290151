"""`trackslip reproduce`: the paper from its first run to its last figure."""

import time
from collections.abc import Mapping
from typing import Any

from experiments.driving.closed_loop import ClosedLoopRun, drive_closed_loops, start_pose
from experiments.driving.grid_runs import cells_of, drive_grid
from experiments.driving.paper_model import KNOWN_LAWS
from experiments.driving.world import World
from experiments.measuring.grid import grid_summary, saturation_warnings, simulated_seconds
from experiments.measuring.paper_comparison import compare_with_paper
from experiments.measuring.tracking import tracking_results
from experiments.options.reproduce import ReproduceConfig
from experiments.options.world import IDENTIFIED
from experiments.recording import record_all
from experiments.recording.failed_runs import results_or_failed_runs
from experiments.report.formats import for_terminal, stages_text
from experiments.report.reproduction import COMPARISON_HEADER, Report, comparison_table, render
from experiments.report.terminal import busy, print_table, progress
from experiments.report.tracking import TRACKING_HEADER, tracking_table
from experiments.storage.manifest import command_line
from experiments.storage.plain_json import plain
from experiments.storage.results import REPORT_FILE, write_results
from sim.run_recorder import RunFailedError
from sim.stopwatch import Stopwatch
from trackslip.identification.identify import identify_samples
from trackslip.identification.result import identification_to_json
from trackslip.identification.samples import usable_samples
from trackslip.logs.runlog import RunLog
from trackslip.slip.base import SlipLaw
from trackslip.slip.compensation import FixedLaw
from trackslip.slip.exponential import PUBLISHED
from trackslip.trajectory.segmented import paper_reference


def run(config: ReproduceConfig) -> None:
    """Drive the grid, identify the laws, verify them in closed loop, store, report and print."""
    began = time.perf_counter()
    watch = Stopwatch()
    world = World.of(config)
    with results_or_failed_runs(config.out, "reproduce", world) as folder:
        geometry = world.robot.geometry
        cells = cells_of(config)
        with progress(f"{len(cells)} runs, scans and poses", config.duration) as report:
            grid_logs = drive_grid(config, world, report, watch)
        with progress("slips and laws", 3, "stages") as report:
            with watch.stage("slips"):
                sampling = usable_samples(grid_logs, geometry, method=config.motion, longest=True)
                report(1)
            with watch.stage("laws"):
                found = identify_samples(sampling, geometry)
                report(1)
            with watch.stage("errors of all methods"):
                names = [cell.name for cell in cells]
                grid = grid_summary(config, names, grid_logs, sampling.samples, geometry, watch)
                report(1)
        laws = {name: fitted.law for name, fitted in found.comparison.laws.items()}
        with watch.stage("closed loops"):
            try:
                tracking_logs = drive_paths(config, world, {name: laws[name] for name in IDENTIFIED if name in laws})
            except RunFailedError as failure:
                failure.logs = [*grid_logs, *failure.logs]
                raise
        tracking = tracking_results(tracking_logs, paper_reference())
        comparison = compare_with_paper(grid, laws, tracking)
        warnings = saturation_warnings(grid_logs)
        with watch.stage("report"), busy("report"):
            manifest = world.manifest("reproduce", time.perf_counter() - began)
            page = Report(
                title="Slip of a tracked robot: the paper and its simulation",
                command=command_line("reproduce"),
                manifest=manifest,
                comparison=comparison,
                radius=grid.radius,
                grid_logs=grid_logs,
                identification=found,
                tracking=tracking,
                tracking_logs=tracking_logs,
                warnings=warnings,
            )
            render(page).write(folder, config.pdf)
        logs = [*grid_logs, *tracking_logs]
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
        write_results(folder, plain(summary), manifest, logs)
        if config.rrd:
            compared: dict[str, list[RunLog]] = {}
            for log in tracking_logs:
                compared.setdefault(f"{log.metadata['controller']} compared", []).append(log)
            with busy("recordings"):
                record_all(folder, logs, compared)
    print_table("Published | simulated", COMPARISON_HEADER, for_terminal(comparison_table(comparison)))
    print_table("Tracking errors of the true pose", TRACKING_HEADER, tracking_table(tracking))
    for warning in summary["warnings"]:
        print(f"warning: {warning}")
    print(stages_text(watch.stages))
    print(f"{config.out / REPORT_FILE}: {wall:.1f} s for {simulated:.0f} s of simulated driving")


def drive_paths(config: ReproduceConfig, world: World, identified: Mapping[str, SlipLaw]) -> list[RunLog]:
    """Drive both controllers with every compensation along the paper's path, as one fleet (Sec. IV)."""
    path = paper_reference()
    laws = {**KNOWN_LAWS, **identified}
    starts = {name: start_pose(name, "paper", path) for name in ("feedforward", "linear")}
    metadata = {"reference": "paper"}
    runs = [
        ClosedLoopRun(f"{name} {law}", f"track {name} {law}", config.seed, name, law, start, metadata=metadata)
        for name, start in starts.items()
        for law in laws
    ]
    with progress(f"{len(runs)} closed loops", path.duration) as report:
        return drive_closed_loops(
            runs, world, path, config.localization, lambda law: FixedLaw(laws[law]), progress=report
        )
