"""Robots with parameters drawn around those of a base, and logs of their drives."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from sim import Fleet
from sim.calibration.candidate import PARAMETERS, Candidate
from sim.robot.robot import compiled
from trackslip import se2
from trackslip.kinematics import Array
from trackslip.logs.runlog import RunLog

PERIOD = 0.05
"""Time between rows [s]: every reading of the encoders, and every second of them a pose."""
_SERVO = 0.01  # [s]


def drawn(base: Candidate, names: Sequence[str], rng: np.random.Generator) -> Candidate:
    """A candidate whose parameters differ from those of `base` as their priors allow, by up to two deviations."""
    values = {}
    for name in names:
        low, high = PARAMETERS[name].limits(base)
        scaled = np.clip(rng.normal(0.0, 0.7), max(low, -2.0), min(high, 2.0))
        values[name] = PARAMETERS[name].unscaled(base, float(abs(rng.normal(0.0, 0.7)) if low == 0 else scaled))
    return base.with_values(values)


def driven(
    candidate: Candidate, rng: np.random.Generator, *, noise: float = 0.003, count: int = 10, duration: float = 15.0
) -> list[RunLog]:
    """Drives by random commands: curves and turns on the spot to both sides, backwards now and then.

    Poses have a noise of `noise` [m] and [rad]; they are the sensor's, by its own clock.
    """
    robot, every = candidate.robot, round(PERIOD / _SERVO)
    fleet = Fleet(compiled(robot), np.zeros((count, 3)), candidate.ground, robot.radius_error)
    margin = 10  # rows before the first and after the last, from which late poses come
    rows = round(duration / PERIOD) + 2 * margin + 1
    commands = np.stack([_commands(rows, rng) for _ in range(count)], axis=1) * 0.9 * fleet.drive.limit
    pose, angle = np.empty((rows, every, count, 3)), np.empty((rows, count, 2))
    for k, command in enumerate(commands):
        angle[k] = fleet.drive.angle
        fleet.command(command)
        for j in range(every):
            pose[k, j] = fleet.pose()
            fleet.advance(_SERVO)
    kept = slice(margin, rows - margin)
    time = np.arange(rows) * PERIOD
    fine = np.arange(rows * every) * _SERVO
    omega = np.concatenate([np.zeros((1, count, 2)), np.diff(angle, axis=0) / PERIOD])
    seen = (time + candidate.clock)[kept]
    logs = []
    for k in range(count):
        true = pose[:, :, k].reshape(-1, 3)
        at = np.stack([np.interp(seen, fine, column) for column in true.T], axis=-1)
        measured = se2.compose(at, candidate.sensor.pose) + noise * rng.standard_normal(at.shape)
        valid = np.arange(len(seen)) % 2 == 0
        log = RunLog(f"drive {k}", time[kept], omega[kept, k], measured, commands[kept, k], valid=valid)
        logs.append(replace(log, pose=np.where(valid[:, None], measured, np.nan)))
    return logs


def _commands(rows: int, rng: np.random.Generator) -> Array:
    """Speeds (T, 2) of the sprockets, of the largest, each held for 1 to 3 s."""
    speeds = np.empty((rows, 2))
    row = 0
    while row < rows:
        held = rng.integers(round(1 / PERIOD), round(3 / PERIOD))
        faster, other = rng.uniform(0.4, 1.0), rng.uniform(-0.4, 1.0)
        kind = rng.choice(4, p=(0.65, 0.15, 0.15, 0.05))
        pair = np.array([(faster, other * faster), (faster, -faster), (-faster, -other * faster), (0.0, 0.0)][kind])
        speeds[row : row + held] = pair[:: rng.choice([-1, 1])]
        row += held
    return speeds
