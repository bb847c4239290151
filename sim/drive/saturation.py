"""The speeds that saturated motors can reach on the ground."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from sim.drive.drive import DriveState, Forecast
from sim.tracks.motors import Balance
from trackslip.kinematics import Array

_TOLERANCE = 0.001  # tolerance on a saturated torque, relative to the largest torque [-]
# numerical noise in the ground's forces, which the engine iterates, relative to the weight
_ROUGHNESS = 0.0002
_STEP = 0.01  # speed step for numerical derivatives of friction and limits [rad/s]
# initial values for torque / (mass * radius^2 * speed) [1/s]: for equal changes on both tracks,
# which accelerate the robot, and for opposite changes while friction holds the heading
_COMMON, _OPPOSITE = 25.0, 12_000.0


def advance_within_limits(
    drive: DriveState, mass: float, gravity: float, run: Callable[[np.ndarray, Array], Array]
) -> None:
    """Advance sprockets (N, 2) by one servo period with torques within the motors' limits.

    A robot with motors that are strong enough moves as its servos demand. The belts of any other
    robot run at the final sprocket speeds for the whole period, so that no motion oscillates
    however stiff the grip. `run` simulates the period from its start for robots (A,) at mean
    sprocket speeds (A, 2) [rad/s], and returns mean tractions (A, 2) [N].
    """
    wanted = drive.forecast(1)
    (start, goal), belt = wanted.omega, wanted.mean[0].copy()
    rows, speed = np.arange(len(goal)), goal.copy()
    motion = Forecast(np.stack([start, speed]), belt[None], wanted.error)
    asked = drive.torque_for(motion, run(rows, belt)[None])[0]
    torque = np.clip(asked, *drive.drive.torque_range(speed))
    carrying = mass * gravity * drive.radius  # torque of a track that carries the robot alone
    tolerance = _TOLERANCE * np.minimum(drive.drive.torque_limit, carrying) + _ROUGHNESS * carrying
    weak = rows[(np.abs(asked - torque) > tolerance).any(axis=1)]
    if weak.size:
        limited = torque[weak] != asked[weak]
        # first try: past speeds if both motors are too weak, otherwise speeds that turn the robot
        # no faster than before
        alone = np.where(limited, start[weak] + (goal - start)[weak, ::-1], goal[weak])
        first = np.where(limited.all(axis=1, keepdims=True), start[weak], alone)
        balance = _balance(drive.of(weak), start[weak], goal[weak], first, mass, tolerance[weak])
        _, torque[weak] = balance.solve(
            lambda going, omega: drive.radius[weak[going]] * run(weak[going], omega)
        )
        speed[weak] = belt[weak] = balance.speed
    least, most = drive.drive.torque_range(speed)
    saturated = (torque <= least) | (torque >= most)
    error = np.where(speed == goal, wanted.error, speed - drive.set_point)
    drive.accept(
        Forecast(np.stack([start, speed]), belt[None], error), torque[None], saturated[None]
    )


def _balance(
    sprockets: DriveState, start: Array, goal: Array, speed: Array, mass: float, tolerance: Array
) -> Balance:
    drive, radius, inertia = (
        sprockets.drive,
        sprockets.radius,
        sprockets.drive.motor.inertia / sprockets.drive.period,
    )

    def required(rows: np.ndarray, omega: Array, load: Array) -> Array:
        return inertia * (omega - start[rows]) + load + drive.motor.loss(omega)

    def stiffness(rows: np.ndarray, omega: Array) -> Array:
        below = omega < goal[rows]
        rise = []
        for each in (omega - _STEP, omega + _STEP):
            least, most = drive.torque_range(each)
            rise.append(required(rows, each, np.zeros_like(each)) - np.where(below, most, least))
        return (rise[1] - rise[0]) / (2 * _STEP)

    common, opposite = np.array([_COMMON, _OPPOSITE]) * mass / 2
    slope = np.array(
        [[common + opposite, common - opposite], [common - opposite, common + opposite]]
    )
    return Balance(
        goal=goal,
        speed=speed,
        slope=slope * (radius[:, :, None] * radius[:, None]),
        tolerance=tolerance,
        required=required,
        limits=lambda _, omega: drive.torque_range(omega),
        stiffness=stiffness,
    )
