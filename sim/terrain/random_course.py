"""Courses drawn at random, of a given difficulty."""

from __future__ import annotations

import numpy as np

from sim.terrain.course import Course
from sim.terrain.fields import Rough
from sim.terrain.limits import require_between, require_number
from sim.terrain.loose import Beams, Pallets
from sim.terrain.pieces import Flat, Gap, Piece, Ramp, SideSlope, Stairs, Step

_EASIEST = 0.5  # smallest drawn difficulty of an obstacle, as a share of the course's
_APART = 1.0  # length of level ground between obstacles [m]
_PALLET = 0.144  # height of a pallet [m]
_MAX_SEED = 2**31


def random_course(
    rng: np.random.Generator, difficulty: float, obstacles: int = 3, width: float = 3.0, friction: float = 0.8
) -> Course:
    """Draw a course of obstacles, each of which ends at the height where it began.

    Args:
        rng: random numbers; the same ones give the same course.
        difficulty: from 0, nearly level, to 1, about the limit of a robot of 1 m with flippers: ramps of 30 degrees,
            steps of 0.25 m, stairs of 0.18 m, gaps of 0.4 m, 0.15 m of roughness, side slopes of 20 degrees.
        obstacles: how many.
        width: see `Course`.
        friction: see `Course`.

    Raises:
        InvalidValueError: for values that aren't allowed.
    """
    require_between("difficulty", difficulty, 0.0, 1.0)
    require_number("obstacles", obstacles)
    pieces: list[Piece] = []
    for _ in range(obstacles):
        pieces += [*_obstacle(rng, difficulty * rng.uniform(_EASIEST, 1.0)), Flat(_APART)]
    return Course(tuple(pieces), width, friction, int(rng.integers(_MAX_SEED)))


def _obstacle(rng: np.random.Generator, difficulty: float) -> tuple[Piece, ...]:
    """An obstacle of any kind that is not too large to be of this difficulty."""

    def between(easiest: float, hardest: float) -> float:
        return float(easiest + difficulty * (hardest - easiest))

    angle, step, rise = between(0.05, 0.52), between(0.02, 0.25), between(0.04, 0.18)
    run, number = float(rng.uniform(0.28, 0.36)), int(rng.integers(3, 7))
    side = float(rng.choice([-1.0, 1.0]))
    obstacles: list[tuple[Piece, ...]] = [
        (Ramp(angle, 1.5), Flat(_APART), Ramp(-angle, 1.5)),
        (Step(step), Step(-step)),
        (Stairs(rise, run, number), Flat(_APART), Stairs(-rise, run, number)),
        (Beams(between(0.02, 0.15), spacing=0.7, number=number, yaw=between(0.0, 0.5)),),
        (Rough(4.0, between(0.01, 0.15)),),
        (Gap(between(0.05, 0.4)),),
        (SideSlope(side * between(0.05, 0.35)),),
    ]
    if step > _PALLET:
        obstacles.append((Pallets(2, spacing=1.8, yaw=between(0.0, 0.5)),))
    return obstacles[rng.integers(len(obstacles))]
