"""Courses of the ten kinds of FTR-Bench, drawn with a difficulty, so that each robot of a batch can have its own.

The sizes are those of FTR-Bench (github.com/nubot-nudt/FTR-Benchmark), scaled by the robot's largest wheel over that of
its robot, or as published where the name ends in `_published`. They are made of boxes only: waves are ridges.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from sim.terrain import Blocks, Course, Piece, Ramp, Stairs, Step
from sim.traverse.courses import APART, WIDTH, between_platforms
from trackslip.errors import require, require_within

KINDS = (
    *("steps_up", "steps_down", "uplifts", "one_sided", "plum_piles"),
    *("waves", "rails", "stairs_up", "stairs_down", "mixed"),
)
"""Kinds of courses."""
PUBLISHED = "_published"
FTR_COURSES = (*KINDS, *(f"{kind}{PUBLISHED}" for kind in KINDS))
"""Names of courses."""
FTR_BOXES = 18
"""Largest number of boxes of such a course."""
_RADIUS = 0.1  # of the track wheels of FTR-Bench's robot [m]
_PILES, _WAVES, _STEPS, _THICKNESS = 4, 3, 4, 0.1  # numbers, and a rail's thickness [m]


def draw_ftr_course(name: str, difficulty: float, rng: np.random.Generator, hull: Sequence[Sequence[float]]) -> Course:
    """Draw a course by its name.

    Args:
        name: one of `FTR_COURSES`.
        difficulty: from 0, the smallest published heights and angles, to 1, the largest; other sizes are drawn evenly.
        rng: random numbers.
        hull: wheels (x, z, radius) of the robot's tracks [m].

    Raises:
        InvalidValueError: for another name or difficulty.
    """
    require(name in FTR_COURSES, "course", name, f"one of {', '.join(FTR_COURSES)}")
    require_within("difficulty", difficulty, 0.0, 1.0)
    kind = name.removesuffix(PUBLISHED)
    scale = 1.0 if name != kind else max(radius for _, _, radius in hull) / _RADIUS
    kinds = [kind]
    if kind == "mixed":
        kinds = rng.choice([each for each in KINDS[:-1] if each != "plum_piles"], 2, replace=False).tolist()
    return between_platforms([_obstacle(each, difficulty, scale, rng) for each in kinds], rng)


def _obstacle(kind: str, difficulty: float, scale: float, rng: np.random.Generator) -> list[Piece]:
    def harder(easiest: float, hardest: float) -> float:
        return scale * (easiest + difficulty * (hardest - easiest))

    def any_size(least: float, most: float) -> float:
        return scale * float(rng.uniform(least, most))

    side = float(rng.choice([-1.0, 1.0]))
    match kind:
        case "steps_up":
            return [Step(harder(0.2, 0.4), APART)]
        case "steps_down":
            return [Step(-harder(0.2, 0.6), APART)]
        case "uplifts":
            height = harder(0.2, 0.4)
            return [Step(height, any_size(0.2, 0.5)), Step(-height, APART)]
        case "one_sided":
            return [Blocks(((0.6, side * WIDTH / 4, 1.2, WIDTH / 2, harder(0.1, 0.3), 0.0),), 1.2)]
        case "plum_piles":
            size, lowest, highest = any_size(0.2, 0.5), 0.01 * scale, harder(0.05, 0.3)
            place = (np.arange(_PILES) + 0.5) * size
            piles = [
                (float(x), float(y), size, size, float(rng.uniform(lowest, highest)), 0.0)
                for x in place
                for y in place - place.mean()
            ]
            return [Blocks(tuple(piles), _PILES * size)]
        case "waves":
            height = harder(0.1, 0.4)
            half = max(any_size(0.25, 1.0) / 2, height)  # at most 45 degrees steep
            angle, slope = math.atan2(height, half), math.hypot(height, half)
            return [Ramp(angle, slope), Ramp(-angle, slope)] * _WAVES
        case "rails":
            yaw, thickness = side * math.radians(10 + 35 * difficulty), _THICKNESS * scale
            length = 2 * APART + WIDTH * math.sin(abs(yaw))
            return [Blocks(((length / 2, 0.0, thickness, WIDTH, harder(0.2, 0.3), yaw),), length)]
        case _:
            tread = any_size(0.2, 0.3)
            rise = tread * math.tan(math.radians(20 + 25 * difficulty))
            return [Stairs(rise if kind == "stairs_up" else -rise, tread, _STEPS)]
