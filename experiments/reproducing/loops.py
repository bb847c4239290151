"""The paper's closed loops, driven by several workers."""

from collections.abc import Callable, Mapping
from dataclasses import replace

import numpy as np

from experiments.driving.closed_loop import ClosedLoopRun, drive_closed_loops, start_pose
from experiments.driving.paper_model import KNOWN_LAWS
from experiments.driving.world import World
from experiments.options.reproduce import ReproduceConfig
from experiments.parallel.executors import Workers, nothing
from experiments.parallel.workers import processors
from experiments.reproducing.share import Share, whole
from sim.stopwatch import Stopwatch
from trackslip.errors import RunFailedError
from trackslip.kinematics import Array
from trackslip.logs.runlog import RunLog
from trackslip.slip.base import SlipLaw
from trackslip.slip.compensation import FixedLaw
from trackslip.trajectory.base import Reference
from trackslip.trajectory.segmented import paper_reference

CONTROLLERS = ("feedforward", "linear")
"""The paper's, in the order of its runs."""


def start_poses() -> dict[str, Array]:
    """Where the runs of each controller begin: poses (3,) [m, m, rad]."""
    return {name: start_pose(name, "paper", paper_reference()) for name in CONTROLLERS}


class Loops:
    """Closed loops that workers drive."""

    def __init__(
        self,
        config: ReproduceConfig,
        identified: Mapping[str, SlipLaw],
        workers: Workers,
        path: Reference | None = None,
    ) -> None:
        """Begin to drive both controllers with every compensation along a path, by default the paper's (Sec. IV)."""
        laws = {**KNOWN_LAWS, **identified}
        metadata = {"reference": "paper"}
        runs = [
            ClosedLoopRun(f"{name} {law}", f"track {name} {law}", config.seed, name, law, start, metadata=metadata)
            for name, start in start_poses().items()
            for law in laws
        ]
        count = min(workers.count, len(runs))
        own = replace(config, threads=max(1, (config.threads or processors()) // count))
        self._places = np.array_split(range(len(runs)), count)  # by controller, if there are two
        path = path or paper_reference()
        begun = [workers.begin(_drive_share, own, laws, path, [runs[k] for k in at]) for at in reversed(self._places)]
        self._results = begun[::-1]  # begun first are those with feedback, which take longest

    def logs(self, watch: Stopwatch, meanwhile: Callable[[], bool] = nothing) -> list[RunLog]:
        """The logs of all runs, when they are driven; raises RunFailedError as `whole` does.

        `watch` gets the work of all workers together; `meanwhile` is what to do until then, as in `Workers.begin`.
        """
        shares = [result(meanwhile) for result in self._results]
        for share in shares:
            watch.add(share.stages)
        return whole(shares, [at.tolist() for at in self._places])


def _drive_share(
    config: ReproduceConfig, laws: Mapping[str, SlipLaw], path: Reference, runs: list[ClosedLoopRun]
) -> Share:
    """Drive runs as one fleet; what a worker does."""
    watch, world = Stopwatch(), World.of(config)
    try:
        with watch.stage("closed loops"):
            logs = drive_closed_loops(runs, world, path, config.localization, lambda law: FixedLaw(laws[law]))
    except RunFailedError as failure:
        return Share(failure.logs, watch.stages, failure)
    return Share(logs, watch.stages)
