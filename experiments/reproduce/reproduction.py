"""The paper from its grid to its report: drive, identify, verify in closed loop, compare, report.

All runs of the grid are one fleet, and so are the closed loops. Another process draws the figures: those of the grid
while the closed loops are driven.
"""

from __future__ import annotations

from typing import Any

from experiments.common.formats import stages_text
from experiments.common.manifest import command_line
from experiments.common.page import draw_plots
from experiments.common.pool import processors, workers
from experiments.common.results import REPORT_FILE
from experiments.common.run import Run
from experiments.recorder import record_all
from experiments.reproduce.comparison import comparison_table
from experiments.reproduce.config import Config
from experiments.reproduce.page import closed_loops, grid_results, page
from experiments.simulate.closed_loop import ClosedLoopRun, drive_closed_loops, start_pose
from experiments.simulate.grid_runs import cells_of, drive_cells
from experiments.simulate.grid_summary import grid_summary, saturation_warnings, simulated_seconds
from experiments.simulate.options import IDENTIFIED
from experiments.simulate.paper_model import published_runs
from experiments.simulate.tracking import tracking_results
from experiments.simulate.tracking_table import tracking_table
from experiments.simulate.world import World
from trackslip.errors import RunFailedError, counted
from trackslip.identification.identify import identify_samples
from trackslip.identification.result import identification_to_json
from trackslip.identification.samples import usable_samples
from trackslip.logs.runlog import RunLog
from trackslip.slip.compensation import KNOWN_LAWS, FixedLaw
from trackslip.slip.exponential import PUBLISHED
from trackslip.trajectory.segmented import paper_reference

CONTROLLERS = ("feedforward", "linear")
"""The paper's, in the order of its runs."""


def reproduce(config: Config) -> None:
    """Drive the grid, identify the laws, verify them in closed loop, compare with the paper, store, report, print."""
    world, path = World.of(config), paper_reference()
    geometry, cells = world.robot.geometry, cells_of(config)
    drawing = workers("processes" if (config.threads or processors()) > 1 else "inline", 1)
    with Run(config) as run, drawing as pool:
        # drive the grid of radii and speeds
        with run.busy(f"{counted(len(cells), 'run')}, scans and poses"):
            grid_logs = drive_cells(cells, [world] * len(cells), watch=run.watch)

        # identify the slip laws
        with run.busy("slips and laws"):
            with run.watch.stage("slips"):
                sampling = usable_samples(grid_logs, geometry, method=config.motion, longest=True)
            with run.watch.stage("laws"):
                found = identify_samples(sampling, geometry)
            fitted = {name: one.law for name, one in found.comparison.laws.items()}
            names = [cell.name for cell in cells]
            grid = grid_summary(config, names, grid_logs, sampling.samples, geometry, run.watch)

        # verify them in closed loop
        with run.busy("closed loops"):
            results = grid_results(found, grid_logs, grid.radius)
            grid_figures = draw_plots(results, config.pdf, pool.map)
            laws = {**KNOWN_LAWS, **{name: fitted[name] for name in IDENTIFIED}}
            starts = {name: start_pose(name, "paper", path) for name in CONTROLLERS}
            loops = [
                ClosedLoopRun(
                    f"{name} {law}",
                    f"track {name} {law}",
                    config.seed,
                    name,
                    law,
                    start,
                    metadata={"reference": "paper"},
                )
                for name, start in starts.items()
                for law in laws
            ]
            try:
                with run.watch.stage("closed loops"):
                    loop_logs = drive_closed_loops(
                        loops, world, path, config.localization, lambda law: FixedLaw(laws[law])
                    )
            except RunFailedError as failure:
                failure.logs = [*grid_logs, *failure.logs]
                raise

        # compare with the paper
        tracking = tracking_results(loop_logs, path)
        comparison = comparison_table(grid, fitted, tracking)
        warnings = saturation_warnings(grid_logs)

        # report
        logs = [*grid_logs, *loop_logs]
        with run.busy("report"):
            manifest = run.manifest(**world.about)
            driven = closed_loops(found, tracking, loop_logs, published_runs(starts, geometry))
            report = page(command_line("reproduce"), manifest, results, comparison, driven, found, warnings)
            with run.watch.stage("report"):
                loop_figures = draw_plots([driven], config.pdf, pool.map)
                report.write(run.folder, figures=dict([*grid_figures, *loop_figures]))
            summary: dict[str, Any] = {
                **identification_to_json(found),
                "published": {
                    "outer": {"alpha": PUBLISHED.alpha_outer, "beta": PUBLISHED.beta_outer},
                    "inner": {"alpha": PUBLISHED.alpha_inner, "beta": PUBLISHED.beta_inner},
                },
                "warnings": [*warnings, *found.warnings],
                **grid.to_json(),
                "tracking": [result.to_json() for result in tracking],
            }
            simulated = simulated_seconds(logs)
            run.write(summary, logs, simulated, manifest)
        if config.rrd:
            compared: dict[str, list[RunLog]] = {}
            for log in loop_logs:
                compared.setdefault(f"{log.metadata['controller']} compared", []).append(log)
            with run.busy("recordings"):
                record_all(run.folder, logs, compared)

    comparison.print()
    tracking_table(tracking).print()
    if summary["warnings"]:
        print(f"{counted(len(summary['warnings']), 'warning')}: see the report")
    print(f"by stage, some at the same time as others: {stages_text(run.watch.stages)}")
    print(f"{config.out / REPORT_FILE}: {run.wall:.1f} s for {simulated:.0f} s of simulated driving")
