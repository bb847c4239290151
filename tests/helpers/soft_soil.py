"""Fleets on soft soil, and how they drive."""

from dataclasses import replace

import numpy as np

from sim import Fleet
from sim.motors.motor import tireless


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
