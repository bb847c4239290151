"""Robots on stairs and rough ground: how deep their tracks sink in, how fast they get, whether the engine warns."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from experiments.validate.terrain.subjects import STAIRS, BoxRobot, Subject
from experiments.validate.terrain.trial import TerrainTrial
from sim.contact_forces import use_default_contact
from sim.terrain import Course, Rough, Stairs
from trackslip.kinematics import Array

FRICTION = 1.0
CLIMBER = BoxRobot(hull=((-0.3, 0.08, 0.08), (0.25, 0.08, 0.08), (0.4, 0.2, 0.06)), centre_of_mass=(0.05, 0.12))
"""A box that can climb stairs."""
STEPS = 10
"""Number of steps of the stairs."""
SPEED = 0.3
"""Belt speed on stairs, and the largest on rough ground [m/s]."""
ROBOTS = 6
"""Robots on rough ground, and half of those on stairs."""
DURATION = 60.0
"""Time on rough ground [s]."""
RISE = 0.15
"""Rise of the steps [m]."""
_WIDTH = 1.2  # of the stairs [m]
_YAW = (-0.05, 0.0, 0.05)  # headings at which robots begin on stairs [rad]
STAIRS_TIME = 30.0  # [s]
_HOLD = 2.0  # time for which random belt speeds are held [s]
_FIELD = 30.0  # size of the rough ground [m]
_LANDING = 1.0  # time to fall and come to rest, not looked at [s]
_DROP = 0.15  # from which robots are put on rough ground, above its mean [m]


@dataclass(frozen=True)
class Sinking:
    """Penetration, speed and success of robots on terrain."""

    depth: Array  # (K,) largest penetration of a track that touches, per track and physics step [m]
    fastest: float
    """Largest speed of a robot [m/s]."""
    warnings: int
    """Number of the engine's warnings."""
    arrived: int
    """Number of robots that crossed the course."""
    robots: int

    @property
    def typical(self) -> float:
        """The 99th percentile of the depth [m]."""
        return float(np.quantile(self.depth, 0.99))

    @property
    def largest(self) -> float:
        """The largest depth [m]."""
        return float(self.depth.max())


def stairs_course(rise: float = RISE) -> Course:
    """Stairs with treads of 0.28 m, up or down."""
    return Course((Stairs(rise=rise, run=0.28, number=STEPS, width=_WIDTH),), width=4.0, friction=FRICTION)


def rough_course(size: float) -> Course:
    """A square of rough ground, 10 cm from its lowest to its highest point, with cells of 0.1 m."""
    return Course((Rough(length=size, amplitude=0.1, cell=0.1),), width=size, friction=FRICTION)


def climber(subject: Subject) -> Subject:
    """The subject itself, or a box that can climb stairs."""
    return CLIMBER if isinstance(subject, BoxRobot) else subject


def stairs(subject: Subject, preset: str, threads: int, by_default: bool = False, rise: float = RISE) -> Sinking:
    """Cross stairs up or down, straight on and obliquely, with the recipe or with MuJoCo's default contact."""
    course = stairs_course(rise)
    stand = climber(subject).stand(course, preset, flippers=STAIRS)
    if by_default:
        use_default_contact(stand.model)
    trial = TerrainTrial(stand, len(_YAW), threads)
    trial.position[:] += np.array(course.start[:3])
    trial.turn_to(np.array(_YAW))
    trial.drive(np.array([SPEED, SPEED]))
    watch = _Watch(trial)
    for _ in range(round(STAIRS_TIME / trial.timestep)):
        watch.step(trial.position[:, 0] < course.goal)
        if (trial.position[:, 0] >= course.goal).all():
            break
    return watch.found(int((trial.position[:, 0] >= course.goal).sum()))


def rough(subject: Subject, preset: str, rng: np.random.Generator, threads: int) -> Sinking:
    """Drive at random on rough ground."""
    course = rough_course(_FIELD)
    trial = TerrainTrial(subject.stand(course, preset), ROBOTS, threads)
    trial.position[:, 0] = _FIELD * (np.arange(ROBOTS) + 0.5) / ROBOTS
    trial.position[:, 2] += _DROP
    trial.turn_to(rng.uniform(-np.pi, np.pi, ROBOTS))
    trial.advance(_LANDING)
    watch = _Watch(trial)
    for k in range(round(DURATION / trial.timestep)):
        if k % round(_HOLD / trial.timestep) == 0:
            trial.drive(rng.uniform(-SPEED, SPEED, (ROBOTS, 2)))
        watch.step()
    return watch.found(0)


class _Watch:
    """Steps a trial and notes what happens."""

    def __init__(self, trial: TerrainTrial) -> None:
        self._trial = trial
        self._depth: list[Array] = []
        self._fastest = 0.0

    def step(self, rows: np.ndarray | None = None) -> None:
        """A physics step of all robots, or those of `rows` (N,) bool."""
        trial = self._trial
        trial.batch.step(ids=rows)
        reading = trial.belts.read()
        moving = slice(None) if rows is None else rows
        self._depth.append(reading.depth[moving][reading.touching[moving]])
        self._fastest = max(self._fastest, float(np.linalg.norm(trial.velocity, axis=1).max()))

    def found(self, arrived: int) -> Sinking:
        """Everything noted, with the number of robots that arrived."""
        warnings = int(self._trial.batch.warning[..., 1].sum())
        return Sinking(np.concatenate(self._depth), self._fastest, warnings, arrived, self._trial.size)
