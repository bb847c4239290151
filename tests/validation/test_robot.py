"""Robots on Coulomb ground against theory, over radius, speed, friction, length and centre of mass;
physics steps.

MuJoCo's default contact does the same turns, on the same robot with the same friction.
"""

import itertools
import warnings
from dataclasses import replace

import mujoco
import numpy as np
import pytest
from trials import report, use_default_contact

from experiments.common.check import Check
from experiments.common.table import Table, pair, significant
from experiments.validate.measurements import (
    Setup,
    Turns,
    drive_steadily,
    measure_loads,
    paper_turns,
)
from sim import Drive, Ground, RobotParameters
from sim.common.seeds import generator
from trackslip.errors import InvalidValueError, RobotWarning

ROBOTS = {
    "shipped": RobotParameters(),
    "larger": RobotParameters(half_gauge=0.25, contact_length=0.5),
}
RATIOS = (0.7, 0.9, 0.778 / 0.7, 1.4)
"""Friction across over along."""
LENGTHS = (0.75, 1.0, 1.25)
"""Contact lengths over the robot's."""
CENTRES_OF_MASS = ((0.0, 0.0), (0.05, 0.0), (0.0, 0.1), (-0.05, 0.1))
"""Forward over the contact length, and left over the half gauge."""
DURATION = 30  # of random driving [s]
COUNT = 8  # robots that drive at random
REFERENCE = 0.00025  # physics step to compare with [s]
STEPS = (0.0005, 0.001, 0.002, 0.005, 0.01)  # physics steps that are compared [s]


class DefaultContact(Setup):
    """With MuJoCo's default contact."""

    def robot(self, contact_sensors=False):
        robot = super().robot(contact_sensors)
        use_default_contact(robot.model)
        return robot


def variants(parameters):
    """The robot with other lengths and centres of mass, without those that would lift part of a
    track.
    """
    for length, (forwards, left) in itertools.product(LENGTHS, CENTRES_OF_MASS):
        longer = parameters.with_contact_length(length * parameters.contact_length)
        com_x = parameters.com_x + forwards * longer.contact_length
        com_y = parameters.com_y + left * parameters.half_gauge
        try:
            yield replace(longer, com_x=com_x, com_y=com_y)
        except InvalidValueError:
            continue


def all_turns(kind, parameters):
    """Turns of a robot's variants on grounds of several ratios of friction."""
    parts = []
    for variant, ratio in itertools.product(variants(parameters), RATIOS):
        setup = kind(variant, Ground(0.7, 0.7 * ratio))
        _, _, omega = paper_turns(variant)
        parts.append(drive_steadily(setup, omega))
    omega = np.concatenate([part.omega for part in parts])
    belts = np.concatenate([part.belts for part in parts])
    twists = np.concatenate([part.twists for part in parts], axis=1)
    return Turns(omega, belts, twists, parameters.geometry)


def relative_error(values):
    expected, simulated = values
    return simulated / expected - 1


def absolute_error(values):
    expected, simulated = values
    return simulated - expected


def worst_and_median(error, unit=""):
    size = np.abs(error)
    worst = significant(float(size.max()))
    median = significant(float(np.median(size)))
    return pair([worst, median], unit)


@pytest.mark.slow
@pytest.mark.parametrize("name", ROBOTS)
def test_turns_and_loads_beside_the_default_contact(name):
    parameters = ROBOTS[name]
    _, _, omega = paper_turns(parameters)
    with warnings.catch_warnings(action="ignore", category=RobotWarning):
        recipe = all_turns(Setup, parameters)
        default = all_turns(DefaultContact, parameters)
        loads, attitude = measure_loads(Setup(parameters, Ground()), omega)
        default_loads, default_attitude = measure_loads(DefaultContact(parameters, Ground()), omega)
    texts = error_texts(recipe, loads, attitude, parameters.half_gauge)
    default_texts = error_texts(default, default_loads, default_attitude, parameters.half_gauge)
    rows = [(quantity, text, default_texts[quantity]) for quantity, text in texts.items()]
    title = f"{name}: errors in {recipe.half_width.shape[1]:,} turns, worst | median"
    Table(title, ("quantity", "recipe", "default contact"), rows).print()

    width_error = np.abs(relative_error(recipe.half_width))
    median = float(np.median(width_error))
    slip_error = np.abs(absolute_error(recipe.slip)).max()
    default_slip_error = np.abs(absolute_error(default.slip)).max()
    slip_ratio = slip_error / default_slip_error
    load_error = np.abs(absolute_error(loads)).max()
    checks = [
        Check(name, "b + D, worst", width_error.max(), 0.005),
        Check(name, "b + D, median", median, 0.0015),
        Check(name, "slip, over that of the default contact", slip_ratio, 0.1),
        Check(name, "load of a contact point", load_error, 0.05),
    ]
    report(name, checks)


def error_texts(turns, loads, attitude, half_gauge):
    """Errors of simulated against expected turns and loads, by quantity."""
    width_error = 100 * relative_error(turns.half_width)
    offset_error = 100 * relative_error(turns.half_width - half_gauge)
    lateral_error = 1e3 * absolute_error(turns.twists[..., 1])
    load_error = 100 * absolute_error(loads)
    sink = 1e3 * attitude[1, :, 0].mean()
    return {
        "b + D": worst_and_median(width_error, "%"),
        "D alone": worst_and_median(offset_error, "%"),
        "slip": worst_and_median(absolute_error(turns.slip)),
        "lateral speed": worst_and_median(lateral_error, "mm/s"),
        "load of a contact point": worst_and_median(load_error, "%"),
        "sink": significant(sink, "mm", 3),
    }


@pytest.mark.slow
def test_straight_on_robots_do_not_drift():
    heading = 0.3
    fleet = Setup(RobotParameters(), Ground()).fleet([(0.0, 0.0, heading)])
    fleet.command(2 * [0.25 / 0.06])
    fleet.advance(40.0)
    x, y, _ = fleet.pose()[0]
    aside = y * np.cos(heading) - x * np.sin(heading)
    assert abs(aside) < 0.1e-3


@pytest.mark.slow
def test_the_error_is_proportional_to_the_step_and_solvers_agree():
    setup = Setup(RobotParameters(), Ground())
    limit = Drive().top_speed / setup.parameters.sprocket_radius
    rng = generator(0, "convergence")
    commands = rng.uniform(-limit, limit, (DURATION, COUNT, 2))

    def end(step, solver="CG"):
        robot = setup.robot()
        robot.model.opt.timestep = step
        robot.model.opt.solver = getattr(mujoco.mjtSolver, f"mjSOL_{solver.upper()}")
        fleet = setup.fleet(np.zeros((COUNT, 3)), robot=robot)
        for omega in commands:
            fleet.command(omega)
            fleet.advance(1.0)
        return fleet.pose()[:, :2]

    def distance(some, others):
        return float(np.linalg.norm(some - others, axis=1).max())

    own = setup.robot().model.opt.timestep
    exact = end(REFERENCE)
    errors = {step: distance(end(step), exact) for step in STEPS}
    solvers = distance(end(own), end(own, "Newton"))
    rows = []
    for step, error in errors.items():
        rows.append((f"physics step of {1e3 * step:g} ms", significant(1e3 * error, "mm")))
    rows.append(("CG and Newton, at the model's own step", significant(1e3 * solvers, "mm")))
    title = "Distance after 30 s of random commands, largest of 8 robots"
    Table(title, ("", "distance"), rows).print()
    rates = np.array([error / (step - REFERENCE) for step, error in errors.items()])
    assert rates.min() > 0
    assert rates.max() < 2 * rates.min()
    assert solvers < 0.2e-3
