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
from experiments.validate.measurements import Setup, drive_steadily, measure_loads, paper_turns
from sim import Drive, Ground, RobotParameters
from sim.common.seeds import generator
from trackslip.errors import InvalidValueError, RobotWarning

ROBOTS = {
    "shipped": RobotParameters(),
    "larger": RobotParameters(half_gauge=0.25, contact_length=0.5),
}
RATIOS, LENGTHS = (0.7, 0.9, 0.778 / 0.7, 1.4), (0.75, 1.0, 1.25)
"""Friction across over along, and contact lengths over the robot's."""
CENTRES_OF_MASS = ((0.0, 0.0), (0.05, 0.0), (0.0, 0.1), (-0.05, 0.1))
"""Forward over the contact length, and left over the half gauge."""


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
        try:
            yield replace(
                longer, com_x=com_x, com_y=parameters.com_y + left * parameters.half_gauge
            )
        except InvalidValueError:
            continue


def all_turns(kind, parameters):
    """Half widths (2, M), slips (2, M, 2), lateral speeds (2, M) by theory and simulated, and half
    gauge.
    """
    parts = []
    for variant, ratio in itertools.product(variants(parameters), RATIOS):
        turns = drive_steadily(kind(variant, Ground(0.7, 0.7 * ratio)), paper_turns(variant)[2])
        parts.append((turns.half_width, turns.slip, turns.twists[..., 1]))
    return [np.concatenate(part, axis=1) for part in zip(*parts, strict=True)]


def worst_and_median(error, unit=""):
    size = np.abs(error)
    return pair([significant(float(size.max())), significant(float(np.median(size)))], unit)


@pytest.mark.slow
@pytest.mark.parametrize("name", ROBOTS)
def test_turns_and_loads_beside_the_default_contact(name):
    parameters = ROBOTS[name]
    with warnings.catch_warnings(action="ignore", category=RobotWarning):
        recipe, default = (all_turns(kind, parameters) for kind in (Setup, DefaultContact))
        setups, omega = (
            (Setup(parameters, Ground()), DefaultContact(parameters, Ground())),
            paper_turns(parameters)[2],
        )
        loads, attitudes = zip(*(measure_loads(setup, omega) for setup in setups), strict=True)
    b = parameters.half_gauge
    rows = [
        (
            "b + D",
            *(worst_and_median(100 * (w[1] / w[0] - 1), "%") for w, _, _ in (recipe, default)),
        ),
        (
            "D alone",
            *(
                worst_and_median(100 * ((w[1] - b) / (w[0] - b) - 1), "%")
                for w, _, _ in (recipe, default)
            ),
        ),
        ("slip", *(worst_and_median(slip[1] - slip[0]) for _, slip, _ in (recipe, default))),
        (
            "lateral speed",
            *(worst_and_median(1e3 * (u[1] - u[0]), "mm/s") for _, _, u in (recipe, default)),
        ),
        (
            "load of a contact point",
            *(worst_and_median(100 * (load[1] - load[0]), "%") for load in loads),
        ),
        ("sink", *(significant(1e3 * attitude[1, :, 0].mean(), "mm", 3) for attitude in attitudes)),
    ]
    title = f"{name}: errors in {recipe[0].shape[1]:,} turns, worst | median"
    Table(title, ("quantity", "recipe", "default contact"), rows).print()
    error = np.abs(recipe[0][1] / recipe[0][0] - 1)
    slip, by_default = (np.abs(slips[1] - slips[0]).max() for _, slips, _ in (recipe, default))
    report(
        name,
        [
            Check(name, "b + D, worst", error.max(), 0.005),
            Check(name, "b + D, median", float(np.median(error)), 0.0015),
            Check(name, "slip, over that of the default contact", slip / by_default, 0.1),
            Check(name, "load of a contact point", np.abs(loads[0][1] - loads[0][0]).max(), 0.05),
        ],
    )


@pytest.mark.slow
def test_straight_on_robots_do_not_drift():
    fleet = Setup(RobotParameters(), Ground()).fleet([(0.0, 0.0, 0.3)])
    fleet.command(2 * [0.25 / 0.06])
    fleet.advance(40.0)
    x, y, _ = fleet.pose()[0]
    assert abs(y * np.cos(0.3) - x * np.sin(0.3)) < 0.1e-3


DURATION, COUNT = 30, 8  # of random driving [s], and of robots
REFERENCE = 0.00025  # physics step to compare with [s]


@pytest.mark.slow
def test_the_error_is_proportional_to_the_step_and_solvers_agree():
    setup = Setup(RobotParameters(), Ground())
    limit = Drive().top_speed / setup.parameters.sprocket_radius
    commands = generator(0, "convergence").uniform(-limit, limit, (DURATION, COUNT, 2))

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
        return float(np.hypot(*(some - others).T).max())

    own, exact = setup.robot().model.opt.timestep, end(REFERENCE)
    errors = {step: distance(end(step), exact) for step in (0.0005, 0.001, 0.002, 0.005, 0.01)}
    solvers = distance(end(own), end(own, "Newton"))
    rows = [
        (f"physics step of {1e3 * step:g} ms", significant(1e3 * error, "mm"))
        for step, error in errors.items()
    ]
    rows.append(("CG and Newton, at the model's own step", significant(1e3 * solvers, "mm")))
    Table(
        "Distance after 30 s of random commands, largest of 8 robots", ("", "distance"), rows
    ).print()
    rates = np.array([error / (step - REFERENCE) for step, error in errors.items()])
    assert rates.min() > 0
    assert rates.max() < 2 * rates.min()
    assert solvers < 0.2e-3
