"""Effect of physics step and solver: the same random commands, integrated in different ways."""

from collections.abc import Callable
from dataclasses import dataclass

import mujoco
import numpy as np

from sim.drive.drive import Drive, tireless
from sim.fleet import Fleet
from sim.ground.ground import Ground
from sim.robot.parameters import RobotParameters
from sim.robot.robot import load_robot
from trackslip.kinematics import Array

DURATION = 30.0
"""Duration of the random commands [s]."""
ROBOTS = 8
HOLD = 1.0
"""Time for which each random command is held [s]."""
STEPS = (0.0005, 0.001, 0.002, 0.005, 0.01)
"""Physics steps to compare [s]."""
REFERENCE_STEP = 0.00025
"""Physics step that serves as the reference [s]."""


@dataclass(frozen=True)
class Convergence:
    """Largest distances over all robots after DURATION."""

    step_error: dict[float, float]
    """Physics step [s] -> distance from the end point with REFERENCE_STEP [m]."""
    solver_difference: float
    """Distance between the solvers CG and Newton, at the model's own step [m]."""
    travelled: float
    """Mean distance travelled [m]."""


def converge(
    parameters: RobotParameters,
    ground: Ground,
    generator: np.random.Generator,
    threads: int,
    progress: Callable[[float], None],
) -> Convergence:
    """Drive the same commands with every step and both solvers; `progress` is called with shares that add up to 1."""
    limit = Drive().top_speed / parameters.sprocket_radius
    commands = generator.uniform(-limit, limit, (round(DURATION / HOLD), ROBOTS, 2))  # [rad/s]
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
        fleet.advance(HOLD)
        way += float(np.hypot(*(fleet.pose()[:, :2] - before).T).mean())
    return fleet.pose()[:, :2], way
