"""Belts with motors: the steepest slope by torque, and the balance of impulse and of energy while speeding up."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from experiments.validate.terrain.subjects import Subject
from experiments.validate.terrain.trial import LevelGround, TerrainTrial, limit
from experiments.validate.theory import GRAVITY
from trackslip.kinematics import Array

_SLOPE = float(np.radians(15.0))
_SPEED = 0.2  # set point [m/s]
_AROUND, _ROWS = 0.03, 13  # where the torque that climbs is looked for, relative to theory
_CLIMB, _PUSH = 1.5, 0.3  # [s]
_HEAVY = 0.2  # mass of a belt and its drive, J / r^2, over the robot's [-]
_PART = 0.3  # force of both motors, over the weight [-]


@dataclass(frozen=True)
class MotorErrors:
    """Errors of belts with motors, relative to theory [-]."""

    climbing: float
    """Of the torque with which a slope is climbed: 2 T / r = m g sin(slope)."""
    impulse: float
    """Of the change of the belts' momentum: the time integral of T / r - F = J / r^2 times the change of speed."""
    energy: float
    """Of the energy drawn: the work of the traction and the belts' kinetic energy."""


def motor_errors(subject: Subject, preset: str, threads: int) -> MotorErrors:
    """Errors of a robot's belts with motors on a plane."""
    stand = subject.stand(LevelGround(), preset)
    weight, radius = GRAVITY * float(stand.model.body_subtreemass[0]), float(stand.view.wheels[:, 2].max())
    expected = weight * np.sin(_SLOPE) * radius / 2

    def slides(torque: np.ndarray) -> np.ndarray:
        trial = TerrainTrial(stand, len(torque), threads)
        trial.tilt(np.full(len(torque), _SLOPE))
        _set(trial, _SPEED, np.repeat(torque[:, None], 2, axis=1), 0.0)
        for _ in range(round(_CLIMB / trial.timestep)):
            trial.belts.step()
        return trial.velocity[:, 0] < 0

    found = limit(slides, (1 - _AROUND) * expected, (1 + _AROUND) * expected, _ROWS, 1)
    return MotorErrors(abs(found / expected - 1), *_balance(TerrainTrial(stand, 1, threads), weight, radius))


def _balance(trial: TerrainTrial, weight: float, radius: float) -> tuple[float, float]:
    """Relative errors of impulse and energy of a robot that speeds up from rest."""
    mass = _HEAVY * weight / GRAVITY  # of each belt
    trial.advance(0.5)
    force = _PART * weight / 2
    _set(trial, 10.0, np.full((1, 2), force * radius), mass * radius**2)
    impulse, work = np.zeros(2), np.zeros(2)
    for _ in range(round(_PUSH / trial.timestep)):
        before = trial.belts.motors().speed[0, :2]
        trial.belts.step()
        motor, traction = trial.belts.motors(), trial.belts.read().traction[0, :2]
        impulse += (motor.torque[0, :2] / radius - traction) * trial.timestep
        work += traction * (before + motor.speed[0, :2]) / 2 * trial.timestep
    speed, drawn = motor.speed[0, :2], motor.energy[0, :2]
    momentum, kinetic = mass * speed, mass * speed**2 / 2
    return float(np.abs(impulse / momentum - 1).max()), float(np.abs((work + kinetic) / drawn - 1).max())


def _set(trial: TerrainTrial, speed: float, torque: Array, inertia: float) -> None:
    """Set the motors of the chassis' belts; flippers' belts, which don't touch, have no limits [m/s, N m, kg m^2]."""
    belts = len(trial.belts.names)
    limits = np.full((trial.size, belts), np.inf)
    limits[:, :2] = torque
    trial.belts.set(np.full((trial.size, belts), speed), torque_limit=limits, inertia=inertia)
