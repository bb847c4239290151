"""The paper's grid, driven and measured by several workers."""

from collections.abc import Sequence
from dataclasses import dataclass

from experiments.driving.grid_runs import cells_of, drive_cells
from experiments.driving.world import World
from experiments.options.grid import GridConfig
from experiments.reproducing.grid_shares import GridShares
from experiments.reproducing.share import Share, whole
from sim.stopwatch import Stopwatch
from trackslip.errors import LogError, RunFailedError
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


def driven_grid(shares: GridShares, watch: Stopwatch) -> DrivenGrid:
    """The whole grid, when all shares are driven. Raises RunFailedError as `whole` does.

    `watch` gets the work of all workers together.
    """
    found = [result() for result in shares.results]
    for share in found:
        watch.add(share.stages)
    logs = whole(found, shares.places)
    return DrivenGrid(logs, {run: one for share in found for run, one in share.measured.items()})


def drive_share(config: GridConfig, places: Sequence[int]) -> Share:
    """Drive some of the grid's runs as one fleet and measure them; what a worker does."""
    watch, world, all_cells = Stopwatch(), World.of(config), cells_of(config)
    cells = [all_cells[k] for k in places]
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
