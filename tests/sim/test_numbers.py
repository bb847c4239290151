"""Numbers in the options of environments that aren't finite."""

import dataclasses
import math
from numbers import Real

import gymnasium as gym
import pytest

from sim.ground.ground import Ground
from sim.ground.pull import Pull
from sim.motors.motor import Drive
from sim.path_tracking.config import EnvConfig, TrackingReward
from sim.path_tracking.randomization import Randomization
from sim.robot.parameters import RobotParameters
from sim.scanner.scanner import LaserScanner
from sim.traverse.config import CrossingReward, SensorNoise, TraverseConfig
from sim.traverse.outcome import Limits
from trackslip.errors import InvalidValueError

TYPICAL = Randomization.typical()
WHOLE = (
    EnvConfig(),
    TrackingReward(),
    TYPICAL,
    LaserScanner(),
    Pull(),
    Ground(),
    TraverseConfig(),
    CrossingReward(),
    SensorNoise(),
    Limits(),
    RobotParameters(),
    Drive(),
    Drive().motor,
)
TERMS = ("own_rewards", "own_observations", "privileged")


def changed(value, number):
    """All variants of a value in which one number is replaced."""
    if isinstance(value, tuple):
        return [(*value[:k], number, *value[k + 1 :]) for k in range(len(value))]
    return [number]


def is_number(value):
    return isinstance(value, Real) and not isinstance(value, bool)


def holds_numbers(value):
    items = value if isinstance(value, tuple) and value else (value,)
    return all(item is None or is_number(item) for item in items)


@pytest.mark.parametrize("number", [math.nan, math.inf, -math.inf])
@pytest.mark.parametrize("options", WHOLE, ids=lambda options: type(options).__name__)
def test_numbers_that_are_not_finite_are_refused(options, number):
    fields = {f.name: getattr(options, f.name) for f in dataclasses.fields(options)}
    numbers = {name: value for name, value in fields.items() if holds_numbers(value)}
    for name, value in numbers.items():
        for variant in changed(value, number):
            with pytest.raises(InvalidValueError, match="must be"):
                dataclasses.replace(options, **{name: variant})


@pytest.mark.parametrize("number", [math.nan, math.inf, -math.inf])
@pytest.mark.parametrize("option", TERMS)
@pytest.mark.parametrize("config", [EnvConfig, TraverseConfig])
def test_weights_of_own_terms_must_be_finite(config, option, number):
    with pytest.raises(InvalidValueError, match=r"math:isfinite = .*: must be a"):
        config(**{option: {"math:isfinite": number}})


DRAWN = {
    "PathTracking": ("radius_error", "mass", "lag", "start_error", "com"),
    "Traverse": ("difficulty", "start_offset", "start_heading", "mass"),
}
ERRORS = {"start_error": (0.0, 0.0), "com": (0.0,)}


@pytest.mark.parametrize("number", [math.nan, math.inf, -math.inf])
@pytest.mark.parametrize(
    ("task", "option"), [(task, name) for task, names in DRAWN.items() for name in names]
)
def test_given_values_of_an_episode_must_be_finite(task, option, number):
    env = gym.make(f"sim:trackslip/{task}-v0")
    value = (*ERRORS[option], number) if option in ERRORS else number
    with pytest.raises(InvalidValueError, match=option):
        env.reset(seed=0, options={option: value})
