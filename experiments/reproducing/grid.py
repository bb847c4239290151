"""The paper's grid, driven and measured by several workers."""

from dataclasses import dataclass, replace

from experiments.driving.grid_runs import Cell, cells_of, drive_cells
from experiments.driving.world import World
from experiments.options.grid import GridConfig
from experiments.parallel.executors import Workers
from experiments.reproducing.share import Share, whole
from sim.run_recorder import RunFailedError
from sim.stopwatch import Stopwatch
from trackslip.errors import LogError
from trackslip.identification.samples import MeasuredRun, MeasuredRuns, part_by_method, steadily_driven
from trackslip.identification.true_samples import true_sample
from trackslip.logs.runlog import RunLog
from trackslip.motion.methods import MOTION_METHODS, best_method


@dataclass(frozen=True)
class DrivenGrid:
    """All runs of a grid."""

    logs: list[RunLog]
    measured: MeasuredRuns
    """What was found of each steady run."""


def drive_grid(config: GridConfig, workers: Workers, watch: Stopwatch) -> DrivenGrid:
    """Drive and measure the grid; every worker has its share of the runs. Raises RunFailedError as `whole` does.

    `watch` gets the work of all workers together.
    """
    cells = cells_of(config)
    count = min(workers.count, len(cells))
    places = [range(k, len(cells), count) for k in range(count)]  # the radii of a share as different as those of all
    own = replace(config, threads=max(1, workers.count // count))
    results = [workers.begin(_drive_share, own, [cells[k] for k in at]) for at in places]
    shares = [result() for result in results]
    for share in shares:
        watch.add(share.stages)
    logs = whole(shares, places)
    return DrivenGrid(logs, {run: found for share in shares for run, found in share.measured.items()})


def _drive_share(config: GridConfig, cells: list[Cell]) -> Share:
    """Drive runs as one fleet and measure them; what a worker does."""
    watch, world = Stopwatch(), World.of(config)
    try:
        logs = drive_cells(cells, [world] * len(cells), watch=watch)
    except RunFailedError as failure:
        return Share(failure.logs, watch.stages, failure)
    measured: dict[str, MeasuredRun] = {}
    geometry = world.robot.geometry
    for log in logs:
        chosen = config.motion or best_method(log)
        others = [name for name in MOTION_METHODS if name != chosen]
        try:
            with watch.stage("slips"):
                part = steadily_driven(log, geometry)
                by_method = part_by_method(part, geometry, [chosen])
            with watch.stage("errors of all methods"):
                by_method |= part_by_method(part, geometry, others)
        except LogError:
            continue  # it has no steady stretch; whoever wants its sample is told
        measured[log.run] = MeasuredRun(part.window, part.notes, by_method, true_sample(part, geometry))
    return Share(logs, watch.stages, measured=measured)
