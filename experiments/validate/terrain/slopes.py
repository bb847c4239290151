"""Slopes: the steepest that is climbed, creep on one that holds, and those on which a robot tips over."""

from __future__ import annotations

import numpy as np

from experiments.validate.terrain.subjects import Subject
from experiments.validate.terrain.trial import LevelGround, Limit, TerrainTrial, limit
from trackslip.climbing_theory import friction_angle, tips_backwards, tips_sideways
from trackslip.kinematics import Array

FRICTIONS = (0.3, 0.5, 0.7, 0.9)
"""Coefficients at which the climbing limit is looked for [-]."""
_PARKED = 0.7  # the same of parked robots [-]
_CLIMB = 0.05  # belt speed of climbing robots [m/s]
_AROUND = float(np.radians(0.6))  # where the limit is looked for, on both sides of theory [rad]
CLIMBING = 4.0  # [s]
CREEP_ANGLE = float(np.radians(30.0))
"""Slope on which robots are parked [rad]."""
HEADINGS = (0.0, np.pi / 4, np.pi / 2, np.pi)
"""Headings of parked robots; 0 is uphill [rad]."""
_SETTLE, _WATCH = 3.0, 5.0  # [s]
_STICKY = 4.0  # friction with which robots tip over before they slide [-]
_TIP_AROUND = float(np.radians(4.0))  # as above [rad]
TILT, HOLD = 4.0, 4.0  # duration of a slow tilt and after it [s]
_PERIOD = 0.05  # between two steps of the tilt [s]
_TIPPED = float(np.radians(30.0))  # [rad]
ROWS = 9
"""Slopes that are tried side by side, in each of ROUNDS."""
ROUNDS = 2


def climbing_limits(subject: Subject, preset: str, boxed: bool, threads: int) -> tuple[Limit, ...]:
    """The steepest slopes that robots climb from rest, at all FRICTIONS."""
    return tuple(_climbing_limit(subject, preset, LevelGround(friction, boxed), threads) for friction in FRICTIONS)


def _climbing_limit(subject: Subject, preset: str, ground: LevelGround, threads: int) -> Limit:
    stand = subject.stand(ground, preset)

    def climbs(slopes: Array) -> np.ndarray:
        trial = TerrainTrial(stand, len(slopes), threads)
        trial.tilt(slopes)
        trial.drive(np.array([_CLIMB, _CLIMB]))
        trial.advance(CLIMBING)
        return trial.velocity[:, 0] > 0

    expected = float(friction_angle(ground.friction))
    return Limit(limit(climbs, expected - _AROUND, expected + _AROUND, ROWS, ROUNDS), expected)


def creep(subject: Subject, preset: str, boxed: bool, threads: int) -> Array:
    """Speeds (H,) at which robots with HEADINGS creep down a slope of CREEP_ANGLE [m/s]."""
    trial = TerrainTrial(subject.stand(LevelGround(_PARKED, boxed), preset), len(HEADINGS), threads)
    trial.turn_to(np.array(HEADINGS))
    trial.tilt(np.full(len(HEADINGS), CREEP_ANGLE))
    trial.drive(np.zeros(2))
    trial.advance(_SETTLE)
    before = trial.position.copy()
    trial.advance(_WATCH)
    return np.linalg.norm(trial.position - before, axis=1) / _WATCH


def tipping(subject: Subject, preset: str, sideways: bool, threads: int) -> Limit:
    """The slope on which a parked robot tips over: one that stands across it, or points uphill."""
    stand = subject.stand(LevelGround(_STICKY), preset)
    expected = (
        float(tips_sideways(stand.half_gauge + stand.width / 2, stand.view.height))
        if sideways
        else tips_backwards(stand.view)
    )

    def stand_still(slopes: Array) -> np.ndarray:
        trial = TerrainTrial(stand, len(slopes), threads)
        trial.turn_to(np.full(len(slopes), np.pi / 2 if sideways else 0.0))
        trial.drive(np.zeros(2))
        stays = np.ones(len(slopes), bool)
        for k in range(round((TILT + HOLD) / _PERIOD)):
            trial.tilt(slopes * np.sin(np.pi / 2 * min(1.0, k * _PERIOD / TILT)))
            trial.advance(_PERIOD, stays)
            stays &= trial.leaning() < _TIPPED
            if not stays.any():
                break
        return stays

    return Limit(limit(stand_still, expected - _TIP_AROUND, expected + _TIP_AROUND, ROWS, ROUNDS), expected)
