"""What localising the 25 runs of the paper costs beside their physics, and how accurate it is."""

from collections.abc import Callable, Sequence
from dataclasses import replace
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
from trackslip.localization.bound import MIN_ANGLE, scan_ratio_to_bound, viewing_angle
from trackslip.localization.scan import Cluster
from trackslip.logs.runlog import RunLog

MOST = 0.8
"""Largest time of localisation, over that of the physics of the same runs [-]."""
MOST_ERROR = 1.1
"""Largest root mean square error, over its Cramér-Rao bound [-]."""
_EDGE_ON = np.radians(10.0)  # views up to this angle from edge-on are a case of their own
_MOST_FAILED = {"default": 0.013, "noise of 10 mm": 0.0, "dropout of 20 %": 0.9, "edge-on": 0.035}
# percent of the scans that gave no pose at seed 0 when each was still located on its own
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


def _drive(seed: int, watch: Stopwatch, scanner: LaserScanner | None = None) -> list[RunLog]:
    """The 25 runs on one thread."""
    config = GridConfig(seed=seed, threads=1, scanner=scanner or LaserScanner())
    return drive_grid(config, World.of(config), watch=watch)


def _accuracy(case: str, logs: Sequence[RunLog], widest: float = np.inf) -> list[Check]:
    """Largest of the errors of x, y and heading over its bound, and failures, in views up to `widest` from edge-on."""
    pose, true, valid, seen = [], [], [], []
    for log in logs:
        assert log.truth is not None
        assert log.truth.lean is not None
        assert log.scans is not None
        phi = log.truth.pose[:, 2]
        left = np.column_stack([-np.sin(phi), np.cos(phi), np.zeros_like(phi)])
        pose.append(log.pose)
        true.append(log.truth.pose + log.truth.lean[:, None] * left)
        valid.append(log.is_valid)
        seen.append(log.scans.cluster)
    scans = logs[0].scans
    assert scans is not None
    estimated, truth, found = np.concatenate(pose), np.concatenate(true), np.concatenate(valid)
    angle = viewing_angle(scans.scan.from_world(truth))
    asked = angle < widest
    rows = np.flatnonzero(asked & found)
    clusters = Cluster.joined(seen).take(rows)
    ratio = scan_ratio_to_bound(estimated[rows], truth[rows], scans.plate, scans.scan, clusters)
    failed = 100 * float(1 - found[asked].mean())
    most = _MOST_FAILED[case]
    return [
        Check(f"localization, {case}", "error over its bound", float(ratio.max()), MOST_ERROR, "1"),
        Check(f"localization, {case}", "scans without a pose", failed, most, "%"),
    ]
