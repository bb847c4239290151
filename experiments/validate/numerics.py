"""Numerical errors: physics step, solver and energy balance of robots that drive at random."""

from collections.abc import Callable
from dataclasses import dataclass, replace

import mujoco
import numpy as np

from sim.contact_forces import read_contacts
from sim.drive.drive import Drive, tireless
from sim.fleet import Fleet
from sim.ground.ground import Ground
from sim.robot.parameters import RobotParameters
from sim.robot.robot import load_robot
from trackslip.kinematics import Array

DURATION, ROBOTS = 30.0, 8
"""Time for which random commands are driven, and by how many robots, to compare steps and solvers [s]."""
STEPS = (0.0005, 0.001, 0.002, 0.005, 0.01)
"""Physics steps to compare [s]."""
REFERENCE_STEP = 0.00025
"""Physics step that serves as the reference [s]."""
ENERGY_DURATION, ENERGY_ROBOTS = 10.0, 4
"""Duration of the energy balance [s]."""
_HOLD = 1.0  # time for which each random command is held [s]


@dataclass(frozen=True)
class Convergence:
    """Largest distances over all robots after DURATION."""

    step_error: dict[float, float]
    """Physics step [s] -> distance from the end point with REFERENCE_STEP [m]."""
    solver_difference: float
    """Distance between the solvers CG and Newton, at the model's own step [m]."""
    travelled: float
    """Mean distance travelled [m]."""


@dataclass(frozen=True)
class Energy:
    """Energies since the start, summed over ENERGY_ROBOTS, after every physics step [J]."""

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


def converge(
    parameters: RobotParameters,
    ground: Ground,
    generator: np.random.Generator,
    threads: int,
    progress: Callable[[float], None],
) -> Convergence:
    """Drive the same commands with every step and both solvers; `progress` is called with shares that add up to 1."""
    limit = Drive().top_speed / parameters.sprocket_radius
    commands = generator.uniform(-limit, limit, (round(DURATION / _HOLD), ROBOTS, 2))  # [rad/s]
    own_step = load_robot(parameters=parameters).model.opt.timestep
    cases = [("CG", step) for step in (REFERENCE_STEP, *STEPS)] + [("CG", own_step), ("Newton", own_step)]
    work = np.array([1 / step for _, step in cases])
    ends, ways = {}, []
    for case, share in zip(cases, work / work.sum(), strict=True):
        ends[case], way = _drive(parameters, ground, commands, case, threads)
        ways.append(way)
        progress(float(share))

    def distance(one: tuple[str, float], other: tuple[str, float]) -> float:
        return float(np.hypot(*(ends[one] - ends[other]).T).max())

    step_error = {step: distance(("CG", step), ("CG", REFERENCE_STEP)) for step in STEPS}
    return Convergence(step_error, distance(*cases[-2:]), float(np.mean(ways)))


def _drive(
    parameters: RobotParameters, ground: Ground, commands: Array, case: tuple[str, float], threads: int
) -> tuple[Array, float]:
    """Final positions (ROBOTS, 2) [m] and the mean distance travelled [m]."""
    solver, step = case
    robot = load_robot(parameters=parameters)
    robot.model.opt.timestep = step
    robot.model.opt.solver = getattr(mujoco.mjtSolver, f"mjSOL_{solver.upper()}")
    fleet = Fleet(robot, np.zeros((ROBOTS, 3)), ground, parameters.radius_error, tireless(), threads)
    way = 0.0
    for omega in commands:
        before = fleet.pose()[:, :2]
        fleet.command(omega)
        fleet.advance(_HOLD)
        way += float(np.hypot(*(fleet.pose()[:, :2] - before).T).mean())
    return fleet.pose()[:, :2], way


def account(parameters: RobotParameters, ground: Ground, generator: np.random.Generator, threads: int) -> Energy:
    """Drive random commands and account for the energy, each term from an independent source.

    Forces and sliding speeds come from contact sensors, energies from the engine. Over a step, a force acts at the mean
    of the velocities before and after it.
    """
    robot = load_robot(parameters=parameters, contact_sensors=True)
    robot.model.opt.enableflags |= mujoco.mjtEnableBit.mjENBL_ENERGY
    step = robot.model.opt.timestep
    drive = replace(tireless(), period=step)
    fleet = Fleet(robot, np.zeros((ENERGY_ROBOTS, 3)), ground, parameters.radius_error, drive, threads)
    energy, steps = fleet.batch.bind("energy"), round(ENERGY_DURATION / step)
    read, total = [], []
    for k in range(steps + 1):
        if k % round(_HOLD / step) == 0:
            fleet.command(generator.uniform(-fleet.drive.limit, fleet.drive.limit, (ENERGY_ROBOTS, 2)))
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
