"""Short random courses that consist only of boxes, so that each robot in a batch can have its own.

Some courses have one or two obstacles that robots often meet; the others are of the ten kinds in
FTR-Bench (github.com/nubot-nudt/FTR-Benchmark). FTR-Bench courses are scaled by the ratio of the
robot's largest wheel to that of the FTR-Bench robot, except those whose names end in `_published`,
which have the published sizes; waves are ridges.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final

import numpy as np

from sim.terrain import Beams, Blocks, Course, Flat, Gap, Piece, Ramp, Stairs, Step
from trackslip.errors import require_one_of, require_within

RANDOM: Final = "random"
"""Name for courses with random obstacles."""
MAX_BOXES: Final = 9
"""Largest number of boxes on a course with random obstacles."""
OBSTACLES: Final = ("ramp", "step up", "step down", "stairs up", "stairs down", "beams", "gap")
"""Kinds of obstacles on courses with random obstacles."""
WIDTH: Final = 2.0
"""Width of drawn courses [m]."""
APART: Final = 0.7
"""Length of level ground between two obstacles and behind a step [m]."""
_START: Final = 1.6  # length of the platform before the obstacles [m]
_GOAL: Final = 1.2  # and behind them [m]
_SEEDS: Final = 2**31
KINDS: Final = (
    "steps_up",
    "steps_down",
    "uplifts",
    "one_sided",
    "plum_piles",
    "waves",
    "rails",
    "stairs_up",
    "stairs_down",
    "mixed",
)
"""Kinds of courses from FTR-Bench."""
_MIXED: Final = tuple(kind for kind in KINDS if kind not in ("plum_piles", "mixed"))
_PARTS: Final = 2  # number of obstacles on a mixed course
PUBLISHED: Final = "_published"
"""End of the names of FTR-Bench courses with the published sizes."""
FTR_COURSES: Final = (*KINDS, *(f"{kind}{PUBLISHED}" for kind in KINDS))
"""Names of the FTR-Bench courses."""
DRAWN: Final = (RANDOM, *FTR_COURSES)
"""Names of courses that are drawn anew for each run."""
FTR_BOXES: Final = 18
"""Largest number of boxes on an FTR-Bench course."""
_RADIUS: Final = 0.1  # radius of the FTR-Bench robot's track wheels [m]
_PILES: Final = 4  # number of piles along and across
_WAVES: Final = 3
_STEPS: Final = 4
_RAIL_THICKNESS: Final = 0.1  # [m]
# smallest ratio of the friction coefficient to the steepest slope's tangent at which robots can
# climb [-]
_GRIP: Final = 1.15


def draw_course(
    name: str,
    difficulty: float,
    rng: np.random.Generator,
    hull: Sequence[Sequence[float]],
    obstacles: int = 2,
    kinds: Sequence[str] = OBSTACLES,
) -> Course:
    """Draw a course by its name in `DRAWN` for a robot whose tracks have the wheels `hull` (x, z,
    radius) [m].

    A random course has one or two `obstacles` of these `kinds`, from tiny (`difficulty` 0) up to
    the rescue robot's limits (1). FTR-Bench courses have heights and angles between the smallest
    (0) and the largest published (1); their other sizes are drawn uniformly. Raises
    InvalidValueError for any other name or difficulty.
    """
    require_one_of("course", name, DRAWN)
    require_within("difficulty", difficulty, 0.0, 1.0)
    drawn = []
    if name == RANDOM:
        for _ in range(obstacles):
            kind = kinds[int(rng.integers(len(kinds)))]
            drawn.append(_obstacle(kind, difficulty, rng))
    else:
        kind = name.removesuffix(PUBLISHED)
        is_published = name != kind
        largest = max(radius for _, _, radius in hull)
        scale = 1.0 if is_published else largest / _RADIUS
        parts = [kind]
        if kind == "mixed":
            parts = rng.choice(_MIXED, _PARTS, replace=False).tolist()
        drawn = [_ftr_obstacle(part, difficulty, scale, rng) for part in parts]

    pieces: list[Piece] = []
    for obstacle in drawn:
        if pieces:
            pieces.append(Flat(APART))
        pieces += obstacle
    enough = _GRIP * max(_slopes(pieces), default=0.0)
    friction = max(float(rng.uniform(0.6, 0.9)), enough)
    seed = int(rng.integers(_SEEDS))
    return Course(tuple(pieces), WIDTH, friction, seed, start_length=_START, goal_length=_GOAL)


def _slopes(pieces: Sequence[Piece]) -> list[float]:
    """Tangents of the slopes of ramps and stairs."""
    slopes = []
    for piece in pieces:
        if isinstance(piece, Ramp):
            slopes.append(abs(math.tan(piece.angle)))
        if isinstance(piece, Stairs):
            slopes.append(abs(piece.rise / piece.run))
    return slopes


def _obstacle(kind: str, difficulty: float, rng: np.random.Generator) -> list[Piece]:
    """An obstacle whose `kind` is in `OBSTACLES`, with 50 to 100 % of the size that the difficulty
    allows.
    """
    size = difficulty * rng.uniform(0.5, 1.0)

    def between(easiest: float, hardest: float) -> float:
        return easiest + float(size) * (hardest - easiest)

    # drawn for every kind
    run = float(rng.uniform(0.26, 0.34))
    number = int(rng.integers(2, 5))
    step = between(0.02, 0.32)
    rise = between(0.02, 0.24)
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
            spacing = float(rng.uniform(0.45, 0.7))
            return [Beams(between(0.02, 0.2), spacing, number, yaw=between(0.0, 0.5))]
        case _:
            return [Gap(between(0.05, 0.5))]


def _ftr_obstacle(
    kind: str, difficulty: float, scale: float, rng: np.random.Generator
) -> list[Piece]:
    """An obstacle whose `kind` is in `KINDS`, other than mixed, on a `scale` [-]."""

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
            block = (0.6, side * WIDTH / 4, 1.2, WIDTH / 2, harder(0.1, 0.3), 0.0)
            return [Blocks((block,), 1.2)]
        case "plum_piles":
            size = any_size(0.2, 0.5)
            lowest = 0.01 * scale
            highest = harder(0.05, 0.3)
            place = (np.arange(_PILES) + 0.5) * size
            piles = []
            for x in place.tolist():
                for y in (place - place.mean()).tolist():
                    height = float(rng.uniform(lowest, highest))
                    piles.append((x, y, size, size, height, 0.0))
            return [Blocks(tuple(piles), _PILES * size)]
        case "waves":
            height = harder(0.1, 0.4)
            half = max(any_size(0.25, 1.0) / 2, height)  # at most 45 degrees steep
            angle = math.atan2(height, half)
            slope = math.hypot(height, half)
            return [Ramp(angle, slope), Ramp(-angle, slope)] * _WAVES
        case "rails":
            yaw = side * math.radians(10 + 35 * difficulty)
            thickness = _RAIL_THICKNESS * scale
            length = 2 * APART + WIDTH * math.sin(abs(yaw))
            block = (length / 2, 0.0, thickness, WIDTH, harder(0.2, 0.3), yaw)
            return [Blocks((block,), length)]
        case _:
            tread = any_size(0.2, 0.3)
            rise = tread * math.tan(math.radians(20 + 25 * difficulty))
            return [Stairs(rise if kind == "stairs_up" else -rise, tread, _STEPS)]
