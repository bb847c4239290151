"""The place of the poses' sensor, for commands that read logs."""

import math

from experiments.common.options import Within

_MAX_LEVER = 100.0  # [m]
MAX_CLOCK_OFFSET = 0.5
"""Largest difference of the encoders' and the poses' clocks [s]."""


def check_sensor(sensor: tuple[float, float, float] | None, middle: str = "middle of the tracks") -> None:
    """Raise InvalidValueError unless a sensor is near the robot; None is valid."""
    if sensor is not None:
        for value, where in zip(sensor, ("ahead", "left"), strict=False):
            Within(-_MAX_LEVER, _MAX_LEVER, f"m, {where} of the {middle}").check("sensor", value)
        Within(-math.pi, math.pi, "rad, counter-clockwise").check("sensor", sensor[2])
