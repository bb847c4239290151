"""Where does the energy go? What the belts put in is lost in friction or moves the robot."""

from __future__ import annotations

from dataclasses import dataclass

import mujoco
import numpy as np

from sim.drive import Drive
from sim.fleet import Fleet
from sim.ground import Ground
from sim.instruments import read_contacts
from sim.robot import load_robot
from sim.robot_parameters import RobotParameters
from trackslip.kinematics import Array

DURATION = 10.0
"""Of the random commands [s]."""
ROBOTS = 4


@dataclass(frozen=True)
class Energy:
    """Energies of ROBOTS together since the start, after every physics step [J]."""

    time: Array  # (T,) [s]
    traction: Array  # (T,) put in by the belts
    friction: Array  # (T,) lost where belts slide
    kinetic: Array  # (T,) of the robots, potential energy included

    @property
    def residual(self) -> float:
        """Largest difference of what is put in and what became of it, over all that was put in [-]."""
        return float(np.abs(self.traction - self.friction - self.kinetic).max() / self.traction[-1])


def account(parameters: RobotParameters, ground: Ground, generator: np.random.Generator, threads: int) -> Energy:
    """Drive at random and keep accounts, every term from another source.

    Forces and sliding speeds come from contact sensors, energies from the engine. Over a step, a force acts at the mean
    of the velocities before and after it.
    """
    robot = load_robot(parameters=parameters, contact_sensors=True)
    robot.model.opt.enableflags |= mujoco.mjtEnableBit.mjENBL_ENERGY
    step = robot.model.opt.timestep
    drive = Drive(period=step)
    fleet = Fleet(robot, np.zeros((ROBOTS, 3)), ground, parameters.radius_error, drive, threads)
    energy = fleet.batch.bind("energy")
    steps = round(DURATION / step)
    force, load_speed, belt, total = [], [], [], []
    for k in range(steps + 1):
        if k % round(1.0 / step) == 0:
            fleet.command(generator.uniform(-fleet.drive.limit, fleet.drive.limit, (ROBOTS, 2)))
        fleet.advance(step)
        contacts = read_contacts(fleet)
        force.append(contacts.force)
        load_speed.append(contacts.velocity)
        belt.append(contacts.belt)
        total.append(energy.sum(axis=1))
    f, speed, belts, stored = np.array(force[:-1]), np.array(load_speed), np.array(belt[:-1]), np.array(total)
    mean_speed = (speed[:-1] + speed[1:]) / 2
    put_in = -(f[..., 0] * belts).sum(axis=(1, 2)) * step
    sliding = mean_speed.copy()
    sliding[..., 0] += belts
    lost = -(f * sliding).sum(axis=(1, 2, 3)) * step
    return Energy(
        time=np.arange(1, steps + 1) * step,
        traction=np.cumsum(put_in),
        friction=np.cumsum(lost),
        kinetic=(stored[1:] - stored[0]).sum(axis=1),
    )
