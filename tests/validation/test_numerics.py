"""Errors of physics step and solver, of robots that drive at random for half a minute."""

import mujoco
import numpy as np
import pytest

from experiments.common.table import Table, significant
from experiments.validate.measurements import Setup
from sim import Drive, Ground, RobotParameters
from sim.seeds import generator

DURATION, ROBOTS = 30, 8
REFERENCE = 0.00025  # physics step to compare with [s]


@pytest.mark.slow
def test_the_error_is_proportional_to_the_step_and_solvers_agree():
    setup = Setup(RobotParameters(), Ground())
    limit = Drive().top_speed / setup.parameters.sprocket_radius
    commands = generator(0, "convergence").uniform(-limit, limit, (DURATION, ROBOTS, 2))

    def end(step, solver="CG"):
        robot = setup.robot()
        robot.model.opt.timestep = step
        robot.model.opt.solver = getattr(mujoco.mjtSolver, f"mjSOL_{solver.upper()}")
        fleet = setup.fleet(np.zeros((ROBOTS, 3)), robot=robot)
        for omega in commands:
            fleet.command(omega)
            fleet.advance(1.0)
        return fleet.pose()[:, :2]

    def distance(some, others):
        return float(np.hypot(*(some - others).T).max())

    own, exact = setup.robot().model.opt.timestep, end(REFERENCE)
    errors = {step: distance(end(step), exact) for step in (0.0005, 0.001, 0.002, 0.005, 0.01)}
    solvers = distance(end(own), end(own, "Newton"))
    rows = [(f"physics step of {1e3 * step:g} ms", significant(1e3 * error, "mm")) for step, error in errors.items()]
    rows.append(("CG and Newton, at the model's own step", significant(1e3 * solvers, "mm")))
    Table("Distance after 30 s of random commands, largest of 8 robots", ("", "distance"), rows).print()
    rates = np.array([error / (step - REFERENCE) for step, error in errors.items()])
    assert rates.min() > 0
    assert rates.max() < 2 * rates.min()
    assert solvers < 0.2e-3
