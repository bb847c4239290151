"""The paper's grid, shared out before the simulator has been imported."""

from dataclasses import replace
from functools import partial

from experiments.options.grid import GridConfig
from experiments.parallel.by_name import call
from experiments.parallel.executors import Workers


class GridShares:
    """The grid's runs, which workers drive and measure."""

    def __init__(self, config: GridConfig, workers: Workers) -> None:
        """Begin to drive; where nothing runs beside this, that waits until results are asked for."""
        cells = len(config.radii) * len(config.speeds)
        count = min(workers.count, cells)
        self.places = [range(k, cells, count) for k in range(count)]
        """Which runs are in each share: the radii of a share are as different as those of all."""
        own = replace(config, threads=max(1, workers.count // count))
        begin = partial if workers.inline else workers.begin
        self.results = [begin(call, "experiments.reproducing.grid:drive_share", own, at) for at in self.places]
        """Each is called for what a worker drove, a Share."""
