"""Fleets on soft soil, and how they drive."""

from dataclasses import replace

import numpy as np

from sim import Fleet
from sim.motors.motor import tireless
from sim.robot.parameters import SINK
from trackslip.skid_theory import Tracks

GRAVITY = 9.81


def tracks_of(robot):
    """The tracks of a robot's parameters, for the theory, with the springs of its contacts."""
    return Tracks(
        robot.contact_length,
        robot.track_width,
        robot.mass * GRAVITY,
        robot.com_x,
        robot.com_height,
        SINK,
    )


def without_slip_sinkage(ground):
    """A ground whose soil has n1 = 0."""
    return replace(ground, soil=replace(ground.soil, n1=0.0))


def fleet_on(robot, *grounds, **options):
    """A fleet with tireless motors, one robot per ground, all from the origin."""
    return Fleet(robot, np.zeros((len(grounds), 3)), list(grounds), 0.0, tireless(), **options)


def drive(fleet, omega, seconds):
    """Turn the sprockets at `omega` [rad/s] for a time."""
    fleet.command(omega)
    for _ in range(round(seconds / 0.1)):
        fleet.advance(0.1)
