"""Energy balance: what the belts put in is lost in friction or stored in the moving robot."""

from dataclasses import dataclass

import mujoco
import numpy as np

from sim.drive.drive import Drive
from sim.fleet import Fleet
from sim.ground.ground import Ground
from sim.instruments import read_contacts
from sim.robot.parameters import RobotParameters
from sim.robot.robot import load_robot
from trackslip.kinematics import Array

DURATION = 10.0
"""Duration of the random commands [s]."""
ROBOTS = 4


@dataclass(frozen=True)
class Energy:
    """Energies since the start, summed over ROBOTS, after every physics step [J]."""

    time: Array  # (T,) [s]
    traction: Array  # (T,) work of the belts
    friction: Array  # (T,) friction loss of sliding belts
    coulomb: Array  # (T,) the same by Coulomb's law, from loads and sliding speeds alone
    damping: Array  # (T,) loss from vertical motion of the contacts
    kinetic: Array  # (T,) kinetic and potential energy of the robots

    @property
    def residual(self) -> float:
        """Largest imbalance, relative to the largest energy stored [-]."""
        difference = self.traction - self.friction - self.damping - self.kinetic
        return float(np.abs(difference).max() / np.abs(self.kinetic).max())

    @property
    def coulomb_error(self) -> float:
        """Relative difference of the final friction loss from Coulomb's law [-]."""
        return float(self.coulomb[-1] / self.friction[-1] - 1)


def account(parameters: RobotParameters, ground: Ground, generator: np.random.Generator, threads: int) -> Energy:
    """Drive random commands and account for the energy, each term from an independent source.

    Forces and sliding speeds come from contact sensors, energies from the engine. Over a step, a force acts at the mean
    of the velocities before and after it.
    """
    robot = load_robot(parameters=parameters, contact_sensors=True)
    robot.model.opt.enableflags |= mujoco.mjtEnableBit.mjENBL_ENERGY
    step = robot.model.opt.timestep
    fleet = Fleet(robot, np.zeros((ROBOTS, 3)), ground, parameters.radius_error, Drive(period=step), threads)
    energy, steps = fleet.batch.bind("energy"), round(DURATION / step)
    read, total = [], []
    for k in range(steps + 1):
        if k % round(1.0 / step) == 0:
            fleet.command(generator.uniform(-fleet.drive.limit, fleet.drive.limit, (ROBOTS, 2)))
        fleet.advance(step)
        read.append(read_contacts(fleet))
        total.append(energy.sum(axis=1))
    force, load, belts = (np.array([getattr(c, name) for c in read[:-1]]) for name in ("force", "load", "belt"))
    around = (np.array([getattr(c, name) for c in read]) for name in ("velocity", "rising"))
    velocity, rising = ((values[:-1] + values[1:]) / 2 for values in around)
    stored = np.array(total)
    put_in = -(force[..., 0] * belts).sum(axis=(1, 2)) * step
    sliding = velocity.copy()
    sliding[..., 0] += belts
    lost = -(force * sliding).sum(axis=(1, 2, 3)) * step
    limit = np.array([ground.along, ground.across])
    return Energy(
        time=np.arange(1, steps + 1) * step,
        traction=np.cumsum(put_in),
        friction=np.cumsum(lost),
        coulomb=np.cumsum((load * np.hypot(*np.moveaxis(limit * sliding, -1, 0))).sum(axis=(1, 2)) * step),
        damping=np.cumsum(-(load * rising).sum(axis=(1, 2)) * step),
        kinetic=(stored[1:] - stored[0]).sum(axis=1),
    )
