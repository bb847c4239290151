"""`trackslip reproduce`: the paper from its first run to its last figure."""

import importlib
import time

from experiments.options.reproduce import ReproduceConfig
from experiments.parallel.early import load_drawing
from experiments.parallel.executors import helped
from experiments.parallel.interrupts import interrupts_later
from experiments.reproducing.grid_shares import GridShares


def run(config: ReproduceConfig) -> None:
    """Drive the grid, identify the laws, verify them in closed loop, store, report and print.

    This process and its helpers do all that is independent; helpers drive while the rest is being imported here.
    """
    began = time.perf_counter()
    with helped(config.threads) as workers:
        shares = GridShares(config, workers)
        workers.prepare(load_drawing)
        with interrupts_later():  # in a half-imported module they could surface as any other error
            paper = importlib.import_module("experiments.reproducing.paper")
        paper.reproduce(config, workers, shares, began)
