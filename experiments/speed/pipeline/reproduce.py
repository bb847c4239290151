"""`trackslip reproduce` beside its own physics, and on two processors beside one; wall time, as users wait for it."""

import subprocess
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path
from time import perf_counter

import numpy as np

from experiments.driving.grid_runs import before_scanner, cells_of
from experiments.driving.paper_model import KNOWN_LAWS
from experiments.measuring.check import Check, at_least
from experiments.options.grid import GridConfig
from experiments.options.world import IDENTIFIED
from experiments.parallel.executors import processors
from experiments.reproducing.loops import CONTROLLERS
from experiments.speed.simulator import bare_batch
from sim.fleet import SETTLING, Fleet
from sim.robot.robot import load_robot
from trackslip.kinematics import sprocket_speeds
from trackslip.trajectory.segmented import paper_reference

MOST, LEAST_SPEED_UP = 3.0, 1.7
_THREADS = (1, 2)
_ROUNDS_OF = 2  # repeats that make one round, which takes longer than those of other areas
_STEADY = 1.0  # time after which the sprockets turn at their set points [s]


def measure(seed: int, repeats: int, step: Callable[[str], None]) -> tuple[Check, ...]:
    """Run the command in a process of its own, on one thread and on two, each between two runs of the bare engine.

    The bare engine makes the same steps on as many threads: those of the grid and of the closed loops, and those that
    set the robots down. Medians over the rounds. Two processors are compared with one where there are two.
    """
    physics = {threads: BarePhysics(threads) for threads in _THREADS}
    took = np.empty((max(1, repeats // _ROUNDS_OF), len(_THREADS)))
    bare = np.empty_like(took)
    for k in range(len(took)):
        for j, threads in enumerate(_THREADS):
            before = physics[threads].seconds()
            took[k, j] = reproduce_seconds(seed, threads)
            bare[k, j] = (before + physics[threads].seconds()) / 2
            step(f"reproduce, {threads} threads" if threads > 1 else "reproduce, 1 thread")
    over = np.median(took / bare, axis=0).tolist()
    names = [f"time over its physics, {n} threads" if n > 1 else "time over its physics, 1 thread" for n in _THREADS]
    checks = [Check("reproduce", name, value, MOST, "x") for name, value in zip(names, over, strict=True)]
    if processors() > 1:
        faster = float(np.median(took[:, 0] / took[:, 1]))
        checks.append(Check("reproduce", "speed on two processors over one", faster, at_least(LEAST_SPEED_UP), "x"))
    return tuple(checks)


def reproduce_seconds(seed: int, threads: int, out: Path | None = None) -> float:
    """Time that the command takes, start of Python included [s]; its results go to `out`, or are deleted."""
    with tempfile.TemporaryDirectory() as folder:
        options = ["--seed", str(seed), "--threads", str(threads), "--out", str(out or Path(folder) / "out")]
        began = perf_counter()
        subprocess.run([sys.executable, "-m", "experiments", "reproduce", *options], check=True, capture_output=True)
        return perf_counter() - began


class BarePhysics:
    """All physics steps of a reproduction, by the bare engine: robots that drive the grid's circles."""

    def __init__(self, threads: int) -> None:
        """`threads` worker threads."""
        robot, config = load_robot(), GridConfig()
        cells = cells_of(config)
        twist = np.array([(cell.speed, cell.speed / cell.radius) for cell in cells])
        loops = len(CONTROLLERS) * (len(KNOWN_LAWS) + len(IDENTIFIED))
        self._batches = []
        for size, duration in ((len(cells), config.duration), (loops, paper_reference().duration)):
            fleet = Fleet(robot, np.tile(before_scanner(robot), (size, 1)), threads=threads)
            fleet.command(sprocket_speeds(twist[:size], 0.0, robot.geometry))
            fleet.advance(_STEADY)
            steps = round((SETTLING + duration) / robot.model.opt.timestep)
            self._batches.append((bare_batch(fleet), steps))

    def seconds(self) -> float:
        """Make all steps once more, and return the time that they took [s]."""
        began = perf_counter()
        for bare, steps in self._batches:
            bare.step(nstep=steps)
        return perf_counter() - began
