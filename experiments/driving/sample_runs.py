"""A few turns of a robot, for commands that drive nothing worth looking at themselves."""

from __future__ import annotations

from pathlib import Path

from experiments.driving.grid_runs import drive_grid
from experiments.driving.world import World
from experiments.options.grid import GridConfig
from experiments.options.world import Repeatable
from experiments.recording import record_all
from trackslip.paper import COMMANDED_RADII

_SPEED = 0.15  # [m/s]
_DURATION = 20.0  # [s]


def record_turns(folder: Path, robot: Path | None, like: Repeatable) -> None:
    """Let a robot, from its file or the shipped one, turn with the paper's radii, and record each turn."""
    config = GridConfig(
        robot=robot, rrd=True, seed=like.seed, threads=like.threads, speeds=(_SPEED,), duration=_DURATION
    )
    world = World.of(config)
    radii = tuple(radius for radius in COMMANDED_RADII if radius > world.robot.geometry.half_gauge)
    if radii:
        record_all(folder, drive_grid(GridConfig(**vars(config) | {"radii": radii}), world))
