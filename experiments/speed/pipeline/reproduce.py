"""`trackslip reproduce` beside its own physics, and on two processors beside one; wall time, as users wait for it."""

import os
import subprocess
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path
from time import perf_counter

import numpy as np

from experiments.driving.closed_loop import start_pose
from experiments.driving.grid_runs import before_scanner, cells_of
from experiments.driving.lookup import locator
from experiments.measuring.check import Check, at_least
from experiments.options.grid import GridConfig
from experiments.parallel.workers import processors
from experiments.reproducing.loops import CONTROLLERS
from experiments.speed.pipeline.closed_loop import paper_pilots
from experiments.speed.same_motion import WholeMotion
from experiments.speed.simulator import bare_batch, bare_copy
from sim.fleet import SETTLING, Fleet
from sim.robot.robot import load_robot
from sim.runs import closed_loop
from sim.scanner.feed import ScannerFeed
from sim.scanner.scanner import LaserScanner
from sim.seeds import generator
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
    physics = BarePhysics(seed)
    took = np.empty((max(1, repeats // _ROUNDS_OF), len(_THREADS)))
    bare = np.empty_like(took)
    for k in range(len(took)):
        for j, threads in enumerate(_THREADS):
            before = physics.seconds(threads)
            took[k, j] = reproduce_seconds(seed, threads)
            bare[k, j] = (before + physics.seconds(threads)) / 2
            step(f"reproduce, {threads} threads" if threads > 1 else "reproduce, 1 thread")
    over = np.median(took / bare, axis=0).tolist()
    names = [f"time over its physics, {n} threads" if n > 1 else "time over its physics, 1 thread" for n in _THREADS]
    checks = [Check("reproduce", name, value, MOST, "x") for name, value in zip(names, over, strict=True)]
    if processors() > 1:
        faster = float(np.median(took[:, 0] / took[:, 1]))
        checks.append(Check("reproduce", "speed on two processors over one", faster, at_least(LEAST_SPEED_UP), "x"))
    return tuple(checks)


def reproduce_seconds(seed: int, threads: int, out: Path | None = None) -> float:
    """Time that the command takes, start of Python included [s]; its results go to `out`, or are deleted.

    Python keeps the modules that it has compiled, as it does unless PYTHONDONTWRITEBYTECODE is set.
    """
    environment = {name: value for name, value in os.environ.items() if name != "PYTHONDONTWRITEBYTECODE"}
    with tempfile.TemporaryDirectory() as folder:
        options = ["--seed", str(seed), "--threads", str(threads), "--out", str(out or Path(folder) / "out")]
        began = perf_counter()
        command = [sys.executable, "-m", "experiments", "reproduce", *options]
        subprocess.run(command, check=True, capture_output=True, env=environment)
        return perf_counter() - began


class BarePhysics:
    """All physics steps of a reproduction, by the bare engine.

    Robots drive the grid's circles. Those of the closed loops repeat the motion of such loops, whose belts change their
    speeds in every servo period; the laws are stored ones.
    """

    def __init__(self, seed: int) -> None:
        """Drive the closed loops, with the scanner's noise of `seed`, for the bare engine to repeat."""
        robot, config, path = load_robot(), GridConfig(), paper_reference()
        cells = cells_of(config)
        circling = Fleet(robot, np.tile(before_scanner(robot), (len(cells), 1)), threads=1)
        twist = np.array([(cell.speed, cell.speed / cell.radius) for cell in cells])
        circling.command(sprocket_speeds(twist, 0.0, robot.geometry))
        circling.advance(_STEADY)
        pilots = paper_pilots()
        each = len(pilots) // len(CONTROLLERS)
        start = np.repeat([start_pose(name, "paper", path) for name in CONTROLLERS], each, axis=0)
        tracking = Fleet(robot, start, threads=1)
        feed = ScannerFeed(LaserScanner(), tracking, [generator(seed, f"bench {k}") for k in range(len(pilots))])
        self._motion = WholeMotion(tracking, feed.period)
        closed_loop(tracking, pilots, path, feed, locator("plate", robot), progress=lambda _: self._motion.note())
        self._settled = round(SETTLING / robot.model.opt.timestep)
        steps = self._settled + round(config.duration / robot.model.opt.timestep)
        self._circling, self._steps = bare_batch(circling), steps

    def seconds(self, threads: int) -> float:
        """Make all steps once more on some threads, and return the time that they took [s]."""
        circling, settling = bare_copy(self._circling, threads), self._motion.at_start(threads)
        began = perf_counter()
        circling.step(nstep=self._steps)
        settling.step(nstep=self._settled)
        return perf_counter() - began + self._motion.repeat(threads)
