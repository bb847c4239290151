"""The highest single step that robots climb slowly, against statics."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from experiments.validate.terrain.subjects import BoxRobot, Subject, TerrainRobot
from experiments.validate.terrain.trial import FACE, Limit, SingleStep, TerrainTrial, limit, set_heights
from trackslip.climbing_theory import highest_step, tip_over_step
from trackslip.kinematics import Array

SPEED = 0.03
"""Belt speed [m/s]."""
ROWS, ROUNDS = 7, 2
"""Heights that are tried side by side, and how often, each time between two of the last."""
_AROUND = 0.02  # where the limit is looked for, on both sides of theory [m]
_GAP = 0.01  # between the robot and the step at the start [m]
_PATIENCE = 1.5  # time to climb, relative to that at the belts' speed [-]
_PERIOD = 0.1  # between two looks at the robots [s]
_BEYOND = 0.01  # by which the centre of mass of a robot that tips over has passed the edge [m]
_FALLS_BACK = float(np.radians(5.0))  # by which the pitch falls when an attempt fails [rad]
_SHORT = ((-0.2, 0.07, 0.07), (0.2, 0.07, 0.07))
_LONG = ((-0.3, 0.08, 0.08), (0.3, 0.08, 0.08))
_RISING = ((-0.25, 0.08, 0.08), (0.2, 0.08, 0.08), (0.36, 0.2, 0.06))
BOXES = (
    (BoxRobot(_LONG, (0.0, 0.14)), 1.0),
    (BoxRobot(_LONG, (0.06, 0.18)), 1.0),
    (BoxRobot(_SHORT, (0.06, 0.10)), 1.0),
    (BoxRobot(_RISING, (0.0, 0.15)), 0.9),
    (BoxRobot(_RISING, (0.0, 0.12)), 0.7),
    (BoxRobot(_RISING, (0.03, 0.10)), 0.65),
)
"""Boxes and their friction: tipping over the edge limits the first four, friction the last two."""


@dataclass(frozen=True)
class StepLimit(Limit):
    """A highest step [m]."""

    friction: float
    """Coefficient of the belts on ground and step [-]."""
    tips_over: float
    """By the formula for tipping over, if friction were enough [m]."""


def step(subject: Subject, preset: str, friction: float, threads: int) -> StepLimit:
    """Find the highest step that a robot climbs."""
    stand = subject.stand(SingleStep(friction), preset)
    expected = highest_step(stand.view, friction)
    ahead, height, (_, _, radius) = stand.view.ahead, stand.view.height, stand.view.standing[0]
    low, high = max(1e-3, expected - _AROUND), expected + _AROUND
    found = limit(lambda heights: _climb(stand, heights, threads), low, high, ROWS, ROUNDS)
    return StepLimit(found, expected, friction, float(tip_over_step(ahead, height, radius)))


def _climb(stand: TerrainRobot, heights: Array, threads: int) -> np.ndarray:
    """(N,) bool: robots that climb steps of heights (N,) [m] at the first attempt."""
    trial = TerrainTrial(stand, len(heights), threads)
    set_heights(stand.model, trial.batch, heights)
    wheels = stand.view.wheels
    trial.position[:, 0] = FACE - _GAP - float((wheels[:, 0] + wheels[:, 2]).max())
    trial.drive(np.array([SPEED, SPEED]))
    way = FACE - float(trial.centre_of_mass()[0]) + float(heights.max())
    over, trying, steepest = np.zeros(len(heights), bool), np.ones(len(heights), bool), np.zeros(len(heights))
    for _ in range(int(_PATIENCE * way / SPEED / _PERIOD)):
        trial.advance(_PERIOD, trying)
        over |= trial.centre_of_mass() > FACE + _BEYOND
        steepest = np.maximum(steepest, trial.leaning())
        trying &= ~over & (trial.leaning() > steepest - _FALLS_BACK)
        if not trying.any():
            break
    return over
