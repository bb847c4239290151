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
    _, _, omega = paper_turns(parameters)
    with warnings.catch_warnings(action="ignore", category=RobotWarning):
        recipe = all_turns(Setup, parameters)
        default = all_turns(DefaultContact, parameters)
        loads, attitude = measure_loads(Setup(parameters, Ground()), omega)
        default_loads, default_attitude = measure_loads(DefaultContact(parameters, Ground()), omega)
    rows = [
        (quantity, errors, errors_by_default)
        for (quantity, errors), (_, errors_by_default) in zip(
            _error_texts(recipe, loads, attitude, parameters.half_gauge),
            _error_texts(default, default_loads, default_attitude, parameters.half_gauge),
            strict=True,
        )
    ]
    width, slip, _ = recipe
    _, default_slip, _ = default
    title = f"{name}: errors in {width.shape[1]:,} turns, worst | median"
    Table(title, ("quantity", "recipe", "default contact"), rows).print()

    width_error = np.abs(width[1] / width[0] - 1)
    median = float(np.median(width_error))
    slip_error = np.abs(slip[1] - slip[0]).max()
    default_slip_error = np.abs(default_slip[1] - default_slip[0]).max()
    slip_ratio = slip_error / default_slip_error
    load_error = np.abs(loads[1] - loads[0]).max()
    report(
        name,
        [
            Check(name, "b + D, worst", width_error.max(), 0.005),
            Check(name, "b + D, median", median, 0.0015),
            Check(name, "slip, over that of the default contact", slip_ratio, 0.1),
            Check(name, "load of a contact point", load_error, 0.05),
        ],
    )


def _error_texts(turns, loads, attitude, half_gauge):
    """Errors of simulated against expected turns and loads, by quantity."""
    width, slip, lateral = turns
    width_error = 100 * (width[1] / width[0] - 1)
    offset = width - half_gauge
    offset_error = 100 * (offset[1] / offset[0] - 1)
    sink = 1e3 * attitude[1, :, 0].mean()
    return [
        ("b + D", worst_and_median(width_error, "%")),
        ("D alone", worst_and_median(offset_error, "%")),
        ("slip", worst_and_median(slip[1] - slip[0])),
        ("lateral speed", worst_and_median(1e3 * (lateral[1] - lateral[0]), "mm/s")),
        ("load of a contact point", worst_and_median(100 * (loads[1] - loads[0]), "%")),
        ("sink", significant(sink, "mm", 3)),
    ]


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
