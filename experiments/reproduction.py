"""The paper from its grid to its report: drive, identify, verify in closed loop, compare, report.

Runs are driven in shares, each of which is a fleet in a process of its own. The results don't depend on the shares.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from itertools import chain
from typing import TYPE_CHECKING, Any

import numpy as np

from experiments.driving.closed_loop import ClosedLoopRun, drive_closed_loops, start_pose
from experiments.driving.grid_runs import Cell, cells_of, drive_cells
from experiments.driving.paper_model import KNOWN_LAWS, published_runs
from experiments.driving.world import World
from experiments.measuring.grid import grid_summary, measured_run, saturation_warnings, simulated_seconds
from experiments.measuring.sightings import sightings
from experiments.measuring.tracking import tracking_results
from experiments.options.world import IDENTIFIED
from experiments.parallel import Workers, processors, workers
from experiments.recording import record_all
from experiments.report.formats import stages_text
from experiments.run import Run
from experiments.storage.manifest import command_line
from experiments.storage.results import REPORT_FILE
from sim.run_recorder import FAILURE
from sim.stopwatch import Stopwatch
from trackslip.errors import RunFailedError
from trackslip.identification.identify import identify_samples
from trackslip.identification.result import identification_to_json
from trackslip.identification.samples import MeasuredRuns, usable_samples
from trackslip.kinematics import Array
from trackslip.logs.runlog import RunLog
from trackslip.slip.base import SlipLaw
from trackslip.slip.compensation import FixedLaw
from trackslip.slip.exponential import PUBLISHED
from trackslip.trajectory.base import Reference
from trackslip.trajectory.segmented import paper_reference

if TYPE_CHECKING:
    from experiments.commands.reproduce import Config

CONTROLLERS = ("feedforward", "linear")
"""The paper's, in the order of its runs."""
MOST_SHARES = 4
"""Processes that have enough to do with the paper's runs."""
_SAME = 1e-9  # times closer than this are equal [s]


def reproduce(config: Config) -> None:
    """Drive the grid, identify the laws, verify them in closed loop, compare with the paper, store, report, print."""
    world, path = World.of(config), paper_reference()
    geometry, cells = world.robot.geometry, cells_of(config)
    with Run(config) as run, workers("processes", min(config.threads or processors(), MOST_SHARES)) as pool:
        # drive the grid of radii and speeds, and measure every run's slip
        with run.busy(f"{len(cells)} runs, scans and poses"):
            shares = list(grid_shares(config, cells, pool))
            grid_logs = joined(shares, run.watch)
            measured = {name: one for share in shares for name, one in share.measured.items()}

        # identify the slip laws
        with run.busy("slips and laws"), run.watch.stage("laws"):
            sampling = usable_samples(grid_logs, geometry, method=config.motion, longest=True, measured=measured)
            found = identify_samples(sampling, geometry)
            fitted = {name: one.law for name, one in found.comparison.laws.items()}

        # verify them in closed loop
        with run.busy("closed loops"):
            laws = {**KNOWN_LAWS, **{name: fitted[name] for name in IDENTIFIED}}
            loops = closed_loop_shares(config, laws, path, pool)
            # now, while they are under way: matplotlib, which isn't needed to drive
            from experiments.report.paper_comparison import comparison_table
            from experiments.report.reproduction import Report
            from experiments.report.tracking import tracking_table

            names = [cell.name for cell in cells]
            grid = grid_summary(config, names, grid_logs, sampling.samples, geometry, run.watch, measured)
            seen = sightings(grid_logs)
            try:
                tracking_logs = joined(list(loops), run.watch)
            except RunFailedError as failure:
                failure.logs = [*grid_logs, *failure.logs]
                raise

        # compare with the paper
        tracking = tracking_results(tracking_logs, path)
        comparison = comparison_table(grid, fitted, tracking)
        warnings = saturation_warnings(grid_logs)

        # report
        logs = [*grid_logs, *tracking_logs]
        with run.busy("report"):
            report = Report(
                command=command_line("reproduce"),
                manifest=run.manifest(**world.about),
                comparison=comparison,
                radius=grid.radius,
                grid_logs=grid_logs,
                seen=seen,
                identification=found,
                tracking=tracking,
                tracking_logs=tracking_logs,
                published=published_runs(start_poses(path), geometry),
                warnings=warnings,
            )
            with run.watch.stage("report"):
                report.page().write(run.folder, config.pdf, pool.map)
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
            run.write(summary, logs, simulated, report.manifest)
        if config.rrd:
            compared: dict[str, list[RunLog]] = {}
            for log in tracking_logs:
                compared.setdefault(f"{log.metadata['controller']} compared", []).append(log)
            with run.busy("recordings"):
                record_all(run.folder, logs, compared)

    comparison.print()
    tracking_table(tracking).print()
    if summary["warnings"]:
        print(f"{len(summary['warnings'])} warnings: see the report")
    print(f"work of all processes: {stages_text(run.watch.stages)}")
    print(f"{config.out / REPORT_FILE}: {run.wall:.1f} s for {simulated:.0f} s of simulated driving")


@dataclass(frozen=True)
class Share:
    """Some runs in a row, which one worker drove as a fleet."""

    logs: Sequence[RunLog]
    stages: Mapping[str, float]
    """Work by stage [s]."""
    failure: RunFailedError | None = None
    """Why they stopped early."""
    measured: MeasuredRuns = field(default_factory=dict)
    """Slips of steady runs by every method."""

    @property
    def end(self) -> float:
        """When the runs ended [s]; negative if they never began."""
        return float(self.logs[0].time[-1]) if self.logs else -1.0


def grid_shares(config: Config, cells: Sequence[Cell], pool: Workers) -> Iterator[Share]:
    """Begin to drive and measure the grid's runs in shares."""
    own, places = _split(config, len(cells), pool)
    return pool.map(partial(_drive_cells, own), [[cells[k] for k in at] for at in places])


def closed_loop_shares(config: Config, laws: Mapping[str, SlipLaw], path: Reference, pool: Workers) -> Iterator[Share]:
    """Begin to drive both controllers with every compensation along the path in shares."""
    metadata = {"reference": "paper"}
    runs = [
        ClosedLoopRun(f"{name} {law}", f"track {name} {law}", config.seed, name, law, start, metadata=metadata)
        for name, start in start_poses(path).items()
        for law in laws
    ]
    own, places = _split(config, len(runs), pool)
    return pool.map(partial(_drive_closed_loops, own, laws, path), [[runs[k] for k in at] for at in places])


def start_poses(path: Reference) -> dict[str, Array]:
    """Where the runs of each controller begin: poses (3,) [m, m, rad]."""
    return {name: start_pose(name, "paper", path) for name in CONTROLLERS}


def joined(shares: Sequence[Share], watch: Stopwatch) -> list[RunLog]:
    """The logs of all runs in order; `watch` gets the work of all workers.

    Raises RunFailedError if runs of a share failed, with the logs of all runs until the earliest failure.
    """
    for share in shares:
        watch.add(share.stages)
    logs = list(chain.from_iterable(share.logs for share in shares))
    failed = [share for share in shares if share.failure is not None]
    if not failed:
        return logs
    first = min(failed, key=lambda share: share.end)
    failure = RunFailedError(str(first.failure))
    failure.logs = [short for log in logs if (short := _until(log, first.end, str(failure))) is not None]
    raise failure


def _split(config: Config, runs: int, pool: Workers) -> tuple[Config, list[np.ndarray]]:
    """The options of a share, with its part of the engine's threads; and which of the runs are in each share."""
    count = min(pool.count, runs)
    own = replace(config, threads=max(1, (config.threads or processors()) // count))
    return own, np.array_split(np.arange(runs), count)


def _drive_cells(config: Config, cells: Sequence[Cell]) -> Share:
    watch, world = Stopwatch(), World.of(config)
    try:
        logs = drive_cells(cells, [world] * len(cells), watch=watch)
    except RunFailedError as failure:
        return Share(failure.logs, watch.stages, failure)
    found = {log.run: measured_run(log, world.robot.geometry, config.motion, watch) for log in logs}
    return Share(logs, watch.stages, measured={name: one for name, one in found.items() if one is not None})


def _drive_closed_loops(
    config: Config, laws: Mapping[str, SlipLaw], path: Reference, runs: Sequence[ClosedLoopRun]
) -> Share:
    watch, world = Stopwatch(), World.of(config)
    try:
        with watch.stage("closed loops"):
            logs = drive_closed_loops(runs, world, path, config.localization, lambda law: FixedLaw(laws[law]))
    except RunFailedError as failure:
        return Share(failure.logs, watch.stages, failure)
    return Share(logs, watch.stages)


def _until(log: RunLog, end: float, reason: str) -> RunLog | None:
    """A log's rows until a failure [s], with its reason; None for less than two."""
    rows = int(np.count_nonzero(log.time <= end + _SAME))
    return None if rows < 2 else replace(log.between(0, rows), metadata={**log.metadata, FAILURE: reason})
