"""`trackslip reproduce`: reproduce the paper, from its grid of runs to a report.

The runs of the grid are driven as one fleet, and the closed loops as another.
"""

import math
from collections.abc import Sequence
from dataclasses import asdict
from typing import Any, Final

import numpy as np

from experiments.common.manifest import command_line
from experiments.common.results import REPORT_FILE
from experiments.common.run import Run
from experiments.common.table import stages_text
from experiments.recorder import record_all
from experiments.reproduce.comparison import comparison_table
from experiments.reproduce.config import Config
from experiments.reproduce.page import page
from experiments.simulate.closed_loop import ClosedLoopRun, Loop, drive_closed_loops
from experiments.simulate.grid_runs import cells_of, drive_grid
from experiments.simulate.grid_summary import GridSummary, saturation_warnings, simulated_seconds
from experiments.simulate.options import IDENTIFIED
from experiments.simulate.tracking import tracking_results, tracking_table
from experiments.simulate.world import World
from trackslip.errors import LogError, RunFailedError, counted
from trackslip.identification.comparison import REFERENCE
from trackslip.identification.identify import identify_samples
from trackslip.identification.result import identification_to_json
from trackslip.identification.samples import usable_samples
from trackslip.laws.base import SlipLaw
from trackslip.laws.exponential import PUBLISHED
from trackslip.logs.runlog import RunLog
from trackslip.online.compensation import KNOWN_LAWS, FixedLaw
from trackslip.trajectory.segmented import PAPER_START, paper_reference

STARTS: Final = {"feedforward": PAPER_START, "linear": (0.3, -0.2, math.pi / 3)}
"""Start poses (x, y, phi) of the paper's controllers, in the order of its runs (Secs. IV-B and
IV-C) [m, m, rad].
"""


def run(config: Config) -> None:
    """Drive the grid, identify laws, verify them in closed loop, compare with the paper, store,
    report and print.
    """
    world = World.of(config)
    path = paper_reference()
    geometry = world.robot.geometry
    cells = cells_of(config)
    with Run(config) as run:
        with run.busy(f"{counted(len(cells), 'run')}, scans and poses"):
            grid_logs = drive_grid(config, world, run.watch)

        with run.busy("slips and laws"):
            with run.watch.stage("slips"):
                sampling = usable_samples(grid_logs, geometry, method=config.motion, longest=True)
            with run.watch.stage("laws"):
                result = identify_samples(sampling, geometry)
            grid = GridSummary.of_logs(grid_logs, sampling.samples, geometry)

        if REFERENCE not in result.laws:  # the law that the page is about
            about = f"law {REFERENCE}:"
            raise LogError(next(line for line in result.warnings if line.startswith(about)))
        laws: dict[str, SlipLaw] = dict(KNOWN_LAWS)
        laws |= {name: result.laws[name] for name in IDENTIFIED if name in result.laws}
        loops = [
            _loop(name, law, np.array(start), config.seed)
            for name, start in STARTS.items()
            for law in laws
        ]
        with run.busy("closed loops"), run.watch.stage("closed loops"):
            try:
                loop_logs = drive_closed_loops(
                    loops, world, path, Loop(config.localization), lambda law: FixedLaw(laws[law])
                )
            except RunFailedError as failure:
                failure.logs = [*grid_logs, *failure.logs]
                raise
        tracking = tracking_results(loop_logs, path)

        logs = [*grid_logs, *loop_logs]
        warnings = saturation_warnings(grid_logs)
        manifest = run.manifest(**world.about)
        simulated = simulated_seconds(logs)
        with run.busy("report"), run.watch.stage("report"):
            report = page(
                command_line("reproduce"), manifest, grid, result, tracking, loop_logs, warnings
            )
            report.write(run.folder, config.pdf)
        summary: dict[str, Any] = {
            **identification_to_json(result),
            "published": _published(),
            "warnings": [*warnings, *result.warnings],
            **vars(grid),
            "tracking": [errors.to_json() for errors in tracking],
        }
        run.write(summary, logs, simulated, manifest)
        if config.rrd:
            _record(run, logs, loop_logs)

    comparison_table(grid, result, tracking).print()
    tracking_table(tracking).print()
    if summary["warnings"]:
        print(f"{counted(len(summary['warnings']), 'warning')}: see the report")
    print(f"by stage: {stages_text(run.watch.stages)}")
    print(
        f"{config.out / REPORT_FILE}: {run.wall:.1f} s for {simulated:.0f} s of simulated driving"
    )


def _loop(controller: str, law: str, start: Any, seed: int) -> ClosedLoopRun:
    """A closed-loop run along the paper's path."""
    name = f"{controller} {law}"
    return ClosedLoopRun(
        name, f"track {name}", seed, controller, law, start, metadata={"reference": "paper"}
    )


def _published() -> dict[str, dict[str, float]]:
    """The paper's law, as an entry in summary.json."""
    values = asdict(PUBLISHED)
    return {
        track: {key: values[f"{key}_{track}"] for key in ("alpha", "beta")}
        for track in ("outer", "inner")
    }


def _record(run: Run, logs: Sequence[RunLog], loops: Sequence[RunLog]) -> None:
    """Record each run and, for each controller, its runs side by side."""
    compared: dict[str, list[RunLog]] = {}
    for log in loops:
        name = f"{log.metadata['controller']} compared"
        compared.setdefault(name, []).append(log)
    with run.busy("recordings"):
        record_all(run.folder, logs, compared)
