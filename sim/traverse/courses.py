"""Short random courses for learning, made of boxes only, so that each robot of a batch can have its own."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from sim.terrain import Beams, Course, Flat, Gap, Piece, Ramp, Stairs, Step
from trackslip.errors import require, require_within

MAX_BOXES = 9
"""Largest number of boxes of a course that `draw_course` draws."""
OBSTACLES = ("ramp", "step up", "step down", "stairs up", "stairs down", "beams", "gap")
"""Kinds of obstacles that it draws."""
WIDTH = 2.0
"""Width of drawn courses [m]."""
APART = 0.7
"""Length of level ground between two obstacles, and behind a step [m]."""
_START, _GOAL = 1.6, 1.2  # lengths of the platforms before and behind them [m]
_SEEDS = 2**31
_GRIP = 1.15  # friction coefficient over the tangent of the steepest slope, at least: so that robots can climb it [-]


def draw_course(
    rng: np.random.Generator, difficulty: float, obstacles: int = 2, kinds: Sequence[str] = OBSTACLES
) -> Course:
    """Draw a course with a `difficulty` from 0 (hardly an obstacle) to 1 (the rescue robot's limits).

    It has one or two `obstacles` of these `kinds`. Raises InvalidValueError for values that aren't allowed.
    """
    require_within("difficulty", difficulty, 0.0, 1.0)
    require(1 <= obstacles <= 2, "obstacles", obstacles, "1 or 2")
    require_kinds(kinds)
    drawn = [_obstacle(kinds[int(rng.integers(len(kinds)))], difficulty, rng) for _ in range(obstacles)]
    return between_platforms(drawn, rng)


def between_platforms(obstacles: Sequence[Sequence[Piece]], rng: np.random.Generator) -> Course:
    """A course of obstacles, with a friction coefficient that robots don't slide with on its steepest slope."""
    pieces = [piece for obstacle in obstacles for piece in (Flat(APART), *obstacle)][1:]
    slopes = [abs(math.tan(piece.angle)) for piece in pieces if isinstance(piece, Ramp)]
    slopes += [abs(piece.rise / piece.run) for piece in pieces if isinstance(piece, Stairs)]
    friction = max(float(rng.uniform(0.6, 0.9)), _GRIP * max(slopes, default=0.0))
    seed = int(rng.integers(_SEEDS))
    return Course(tuple(pieces), WIDTH, friction, seed, start_length=_START, goal_length=_GOAL)


def require_kinds(kinds: Sequence[str]) -> None:
    """Raise InvalidValueError unless all `kinds` of obstacles are known, and there is one."""
    require(len(kinds) > 0, "kinds", kinds, f"some of {', '.join(OBSTACLES)}")
    for kind in kinds:
        require(kind in OBSTACLES, "kinds", kind, f"some of {', '.join(OBSTACLES)}")


def _obstacle(kind: str, difficulty: float, rng: np.random.Generator) -> list[Piece]:
    """An obstacle of a kind in `OBSTACLES`, between half and all of the size that the difficulty allows."""
    size = difficulty * rng.uniform(0.5, 1.0)

    def between(easiest: float, hardest: float) -> float:
        return easiest + float(size) * (hardest - easiest)

    run, number = float(rng.uniform(0.26, 0.34)), int(rng.integers(2, 5))
    step, rise = between(0.02, 0.32), between(0.02, 0.24)
    match kind:
        case "ramp":
            angle = between(0.05, math.radians(35))
            return [Ramp(angle, 1.0), Flat(0.5), Ramp(-angle, 1.0)]
        case "step up":
            return [Step(step, APART)]
        case "step down":
            return [Step(-step, APART)]
        case "stairs up":
            return [Stairs(rise, run, number)]
        case "stairs down":
            return [Stairs(-rise, run, number)]
        case "beams":
            return [Beams(between(0.02, 0.2), float(rng.uniform(0.45, 0.7)), number, yaw=between(0.0, 0.5))]
        case _:
            return [Gap(between(0.05, 0.5))]
