"""Identifying the laws of the paper's 25 runs, and of tables of samples as a real robot gives; wall time, one thread.

Measured is everything from samples to compared laws: outliers, fits, intervals, bootstrap and cross-validation.
"""

from collections.abc import Callable
from time import perf_counter

import numpy as np

from experiments.driving.grid_runs import cells_of, drive_cells
from experiments.driving.world import World
from experiments.measuring.check import Check
from experiments.options.grid import GridConfig
from experiments.speed.simulator import bare_batch
from sim.fleet import Fleet
from sim.robot.robot import Robot
from sim.seeds import generator
from trackslip.identification.identify import identify_samples
from trackslip.identification.samples import Sampling, SlipSamples, usable_samples
from trackslip.kinematics import RobotGeometry, sprocket_speeds, track_slip
from trackslip.slip.turn_loss import TurnLoss

RUNS, PHYSICS = 1.0, 1.0
"""Largest time for the 25 runs [s], and over that of their physics [-]."""
ROWS = {270: 5.0, 2000: 10.0}
"""Numbers of samples in a table, and the largest time for them [s]."""
_ROUNDS_OF = 2  # repeats that make one round, which takes longer than those of other areas
_FAST = RobotGeometry(0.28, 0.16)
_LAW = TurnLoss(offset=0.3, half_gauge=_FAST.half_gauge, radius_error=0.02, turn_loss=0.35)
_TOP_SPEED = 2.0  # of a belt [m/s]
_SCATTER = 0.03  # of the belts' speeds about the law [-]
_NOISE = 0.01  # of the twists [m/s, rad/s]


def measure(seed: int, repeats: int, step: Callable[[str], None]) -> tuple[Check, ...]:
    """Medians of the times; the bare engine drives the 25 runs next to each round."""
    config = GridConfig(seed=seed)
    world = World.of(config)
    cells = cells_of(config)
    logs = drive_cells(cells, [world] * len(cells))
    driven = usable_samples(logs, world.robot.geometry, longest=True)
    physics = _BarePhysics(world.robot, np.array([(one.speed, one.speed / one.radius) for one in cells]), config)
    tables = {count: table(count, generator(seed, f"bench {count} samples")) for count in ROWS}
    runs, bare = [], []
    rows: dict[int, list[float]] = {count: [] for count in ROWS}
    for _ in range(max(1, repeats // _ROUNDS_OF)):
        bare.append(physics.seconds())
        runs.append(_seconds(driven, world.robot.geometry))
        for count, samples in tables.items():
            rows[count].append(_seconds(samples, _FAST))
        step("laws")
    checks = [
        Check("laws of 25 runs", "fits and bootstrap", float(np.median(runs)), RUNS, "s"),
        Check(
            "laws of 25 runs", "time over that of the physics", float(np.median(np.divide(runs, bare))), PHYSICS, "x"
        ),
    ]
    for count, most in ROWS.items():
        checks.append(Check(f"laws of {count} samples", "fits and bootstrap", float(np.median(rows[count])), most, "s"))
    return tuple(checks)


def table(count: int, rng: np.random.Generator) -> Sampling:
    """Samples of a fast robot: at random forwards, backwards, straight and in place, with heavy-tailed scatter."""
    mean = rng.uniform(0.1, 1, count) * np.where(rng.random(count) < 0.15, -1, 1)
    ratio = rng.uniform(-1.2, 1.2, count)
    kind = rng.random(count)
    ratio[kind > 0.9] = 0.0
    omega = np.column_stack([mean * (1 - ratio), mean * (1 + ratio)])
    in_place = kind < 0.15
    omega[in_place] = (mean * np.sign(ratio))[in_place, None] * [-1.0, 1.0]
    omega *= _TOP_SPEED / _FAST.sprocket_radius / np.maximum(1, np.abs(omega).max(axis=1, keepdims=True))
    size = _FAST.sprocket_radius * np.abs(omega).max(axis=1, keepdims=True)
    scatter = np.clip(rng.standard_t(5, (count, 2)), -4, 4) * [1, 1 / (2 * _FAST.half_gauge)]
    twist = _LAW.twist(omega, _FAST) + _NOISE * rng.standard_normal((count, 2)) + _SCATTER * size * scatter
    names = tuple(f"row {k + 1}" for k in range(count))
    return Sampling(SlipSamples(omega, twist, track_slip(omega, twist, _FAST), names), (), ())


def _seconds(sampling: Sampling, geometry: RobotGeometry) -> float:
    began = perf_counter()
    identify_samples(sampling, geometry, estimate_sensor=None)
    return perf_counter() - began


class _BarePhysics:
    """The physics of the 25 runs by the bare engine, on one thread."""

    def __init__(self, robot: Robot, twist: np.ndarray, config: GridConfig) -> None:
        fleet = Fleet(robot, np.zeros((len(twist), 3)), threads=1)
        fleet.command(sprocket_speeds(twist, 0.0, robot.geometry))
        fleet.advance(1.0)  # until the sprockets turn at their set points
        self._bare, self._steps = bare_batch(fleet), round(config.duration / robot.model.opt.timestep)

    def seconds(self) -> float:
        began = perf_counter()
        self._bare.step(nstep=self._steps)
        return perf_counter() - began
