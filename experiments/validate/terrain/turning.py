"""Steady turns on level ground, on a plane and on a box: half the distance of the ICRs against theory."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from experiments.validate.terrain.subjects import Subject, TerrainRobot
from experiments.validate.terrain.trial import LevelGround, TerrainTrial
from experiments.validate.theory import GRAVITY
from sim.contact_forces import use_default_contact
from trackslip.kinematics import Array
from trackslip.skid_theory import steady_twist

SLOW = ((-0.04, 0.04), (0.0, 0.06), (0.04, 0.08), (0.1, 0.12))
"""Belt speeds of slow turns [m/s]."""
PIVOT = ((-0.5, 0.5),)
"""Belt speeds of a fast turn on the spot [m/s]."""
OFFSET = 0.3
"""Shift of the centre of mass, relative to half of the contact's length [-]."""
FRICTION = 0.7
STEADY, WATCH = 2.0, 2.0
"""Time until robots turn steadily, and over which they are then watched [s]."""
_PERIOD = 0.1  # between two looks at the heading [s]


@dataclass(frozen=True)
class TrackTurns:
    """M steady turns."""

    belts: Array  # (M, 2) left and right [m/s]
    half_width: Array  # (M,) half the distance of the ICRs [m]
    expected: Array  # (M,) by theory [m]
    half_gauge: float
    """Half the distance between the tracks [m]."""

    @property
    def error(self) -> Array:
        """Relative errors (M,) of the half width [-]."""
        return self.half_width / self.expected - 1

    @property
    def outside(self) -> float:
        """The largest relative error of D, how far the ICRs are outside the tracks, with its sign [-]."""
        error = (self.half_width - self.half_gauge) / (self.expected - self.half_gauge) - 1
        return float(error[np.argmax(np.abs(error))])

    @property
    def worst(self) -> float:
        """The largest relative error, with its sign [-]."""
        return float(self.error[np.argmax(np.abs(self.error))])


@dataclass(frozen=True)
class Turning:
    """Turns of one robot and recipe on one ground."""

    slow: TrackTurns
    pivot: TrackTurns
    offset: TrackTurns
    """Slow ones, with the centre of mass shifted forwards by OFFSET."""


def turning(subject: Subject, preset: str, boxed: bool, threads: int, by_default: bool = False) -> Turning:
    """Turn on a plane or a box, with the recipe or with MuJoCo's default contact."""

    def turned(belts: tuple[tuple[float, float], ...], shift: float) -> TrackTurns:
        stand = subject.stand(LevelGround(FRICTION, boxed), preset, shift)
        if by_default:
            use_default_contact(stand.model)
        return _turns(stand, np.array(belts), threads)

    half_length = subject.stand(LevelGround(FRICTION, boxed), preset).half_length
    return Turning(turned(SLOW, 0.0), turned(PIVOT, 0.0), turned(SLOW, OFFSET * half_length))


def _turns(stand: TerrainRobot, belts: Array, threads: int) -> TrackTurns:
    trial = TerrainTrial(stand, len(belts), threads)
    trial.drive(belts)
    trial.advance(STEADY)
    turned, before = np.zeros(len(belts)), trial.heading()
    for _ in range(round(WATCH / _PERIOD)):
        trial.advance(_PERIOD)
        now = trial.heading()
        turned += np.mod(now - before + np.pi, 2 * np.pi) - np.pi
        before = now
    spread = belts[:, 1] - belts[:, 0]
    expected = steady_twist(belts, stand.line_contact(FRICTION), GRAVITY)[:, 2]
    return TrackTurns(belts, spread * WATCH / (2 * turned), spread / (2 * expected), stand.half_gauge)
