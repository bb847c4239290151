"""The paper's closed loops, driven by several workers."""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from experiments.driving.closed_loop import ClosedLoopRun, drive_closed_loops, start_pose
from experiments.driving.paper_model import KNOWN_LAWS
from experiments.driving.world import World
from experiments.options.reproduce import ReproduceConfig
from experiments.parallel.executors import Workers
from experiments.reproducing.share import Share, whole
from sim.run_recorder import RunFailedError
from sim.stopwatch import Stopwatch
from trackslip.logs.runlog import RunLog
from trackslip.slip.base import SlipLaw
from trackslip.slip.compensation import FixedLaw
from trackslip.trajectory.segmented import paper_reference

CONTROLLERS = ("feedforward", "linear")
"""The paper's, in the order of its runs."""


class Loops:
    """Closed loops that workers drive."""

    def __init__(self, config: ReproduceConfig, identified: Mapping[str, SlipLaw], workers: Workers) -> None:
        """Begin to drive both controllers with every compensation along the paper's path (Sec. IV)."""
        path, laws = paper_reference(), {**KNOWN_LAWS, **identified}
        self.starts = {name: start_pose(name, "paper", path) for name in CONTROLLERS}
        metadata = {"reference": "paper"}
        runs = [
            ClosedLoopRun(f"{name} {law}", f"track {name} {law}", config.seed, name, law, start, metadata=metadata)
            for name, start in self.starts.items()
            for law in laws
        ]
        count = min(workers.count, len(runs))
        own = replace(config, threads=max(1, workers.count // count))
        self._places = np.array_split(range(len(runs)), count)  # by controller, if there are two
        self._results = [workers.begin(_drive_share, own, laws, [runs[k] for k in at]) for at in self._places]

    def logs(self, watch: Stopwatch) -> list[RunLog]:
        """The logs of all runs, when they are driven; raises RunFailedError as `whole` does.

        `watch` gets the work of all workers together.
        """
        shares = [result() for result in self._results]
        for share in shares:
            watch.add(share.stages)
        return whole(shares, [at.tolist() for at in self._places])


def _drive_share(config: ReproduceConfig, laws: Mapping[str, SlipLaw], runs: list[ClosedLoopRun]) -> Share:
    """Drive runs as one fleet; what a worker does."""
    watch, world, path = Stopwatch(), World.of(config), paper_reference()
    try:
        with watch.stage("closed loops"):
            logs = drive_closed_loops(runs, world, path, config.localization, lambda law: FixedLaw(laws[law]))
    except RunFailedError as failure:
        return Share(failure.logs, watch.stages, failure)
    return Share(logs, watch.stages)
