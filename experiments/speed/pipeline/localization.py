"""What localising the 25 runs of the paper costs beside their physics, and how accurate it is."""

from collections.abc import Callable, Sequence
from time import perf_counter

import numpy as np

from experiments.driving.grid_runs import before_scanner, cells_of, drive_grid
from experiments.driving.world import World
from experiments.measuring.check import Check
from experiments.options.grid import GridConfig
from experiments.speed.simulator import bare_batch
from sim.fleet import Fleet
from sim.scanner.scanner import LaserScanner
from sim.stopwatch import Stopwatch
from trackslip.kinematics import Array, sprocket_speeds
from trackslip.localization.bound import scan_ratio_to_bound, viewing_angle
from trackslip.localization.scan import Cluster
from trackslip.logs.runlog import RunLog

MOST = 0.8
"""Largest time of localisation, over that of the physics of the same runs [-]."""
MOST_ERROR = 1.1
"""Largest root mean square error over its Cramér-Rao bound [-]."""
_MOST_FAILED = {"default": 0.02, "noise of 10 mm": 0.02, "dropout of 20 %": 1.0, "edge-on": 0.15}
"""Scans without a pose when each was still located on its own, plus a standard deviation of their number [%]."""
_EDGE_ON = np.radians(10.0)  # views up to this angle from edge-on are a case of their own
_STEADY = 1.0  # time after which the sprockets turn at their set points [s]
_ROUNDS_OF = 2  # repeats that make one round, which takes longer than those of other areas


def measure(seed: int, repeats: int, step: Callable[[str], None]) -> tuple[Check, ...]:
    """Localise the runs in four cases, the default one between two runs of the bare engine; `step`: after each round.

    The bare engine makes the same number of steps with as many robots. Wall time on one thread, median over the rounds.
    """
    checks: list[Check] = []
    for case, scanner in (
        ("noise of 10 mm", LaserScanner(noise=0.01)),  # these two warm up
        ("dropout of 20 %", LaserScanner(dropout=0.2)),
    ):
        checks += _accuracy(case, _drive(seed, Stopwatch(), scanner))
        step(f"localization, {case}")
    bare, took, logs = _BarePhysics(), [], []
    for _ in range(max(1, repeats // _ROUNDS_OF)):
        watch = Stopwatch()
        before = bare.seconds()
        logs = _drive(seed, watch)
        took.append(2 * watch.stages["localization"] / (before + bare.seconds()))
        step("localization")
    checks = [*_accuracy("default", logs), *checks, *_accuracy("edge-on", logs, _EDGE_ON)]
    return Check("localization", "time over physics", float(np.median(took)), MOST, "x"), *checks


class _BarePhysics:
    """All physics steps of the 25 runs, by the bare engine on one thread: robots that drive the same circles."""

    def __init__(self) -> None:
        config = GridConfig(threads=1)
        robot, cells = World.of(config).robot, cells_of(config)
        fleet = Fleet(robot, np.tile(before_scanner(robot), (len(cells), 1)), threads=1)
        twist = np.array([(cell.speed, cell.speed / cell.radius) for cell in cells])
        fleet.command(sprocket_speeds(twist, 0.0, robot.geometry))
        fleet.advance(_STEADY)
        self._bare = bare_batch(fleet)
        self._steps = round(config.duration / robot.model.opt.timestep)

    def seconds(self) -> float:
        """Make all steps once more, and return the time that they took [s]."""
        began = perf_counter()
        self._bare.step(nstep=self._steps)
        return perf_counter() - began


def _drive(seed: int, watch: Stopwatch, scanner: LaserScanner | None = None) -> list[RunLog]:
    """The 25 runs on one thread."""
    config = GridConfig(seed=seed, threads=1, scanner=scanner or LaserScanner())
    return drive_grid(config, World.of(config), watch=watch)


def _accuracy(case: str, logs: Sequence[RunLog], widest: float = np.inf) -> list[Check]:
    """Errors of x, y and heading over the bound, and failures, in views up to `widest` from edge-on."""
    first = logs[0].scans
    assert first is not None
    pose, true, found = (np.concatenate(part) for part in zip(*map(_poses, logs), strict=True))
    asked = viewing_angle(first.scan.from_world(true)) < widest
    rows = np.flatnonzero(asked & found)
    seen = Cluster.joined([log.scans.cluster for log in logs if log.scans is not None]).take(rows)
    ratio = scan_ratio_to_bound(pose[rows], true[rows], first.plate, first.scan, seen)
    failed = 100 * float(1 - found[asked].mean())
    name = f"localization, {case}"
    return [
        Check(name, "error over its bound", float(ratio.max()), MOST_ERROR, "x"),
        Check(name, "scans without a pose", failed, _MOST_FAILED[case], "%"),
    ]


def _poses(log: RunLog) -> tuple[Array, Array, np.ndarray]:
    """Estimated and true poses (T, 3) of the plate, which leans with the robot, and whether they are valid."""
    truth = log.truth
    assert truth is not None
    assert truth.lean is not None
    phi = truth.pose[:, 2]
    left = np.column_stack([-np.sin(phi), np.cos(phi), np.zeros_like(phi)])
    return log.pose, truth.pose + truth.lean[:, None] * left, log.is_valid
