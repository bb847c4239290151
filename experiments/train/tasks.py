"""The environments that `trackslip train` learns in, and their policies."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

from experiments.benchmark.cases import plant_ranges
from experiments.common.lookup import find_own_modules
from experiments.train.config import TRAVERSE, Config
from sim.motors.motor import Drive, or_tireless
from sim.path_tracking.config import TrackingReward
from sim.policy import Network, Policy, TrackingPolicy
from sim.robot.named import SHIPPED, load_parameters
from sim.traverse.outcome import Limits
from sim.traverse.policy import OPTIONS

# ranges of errors at the start [m], [rad]
_START_DISTANCE, _START_HEADING = (0.0, 0.2), (-0.4, 0.4)
_REWARD = TrackingReward(
    weight_position=0.8,
    weight_heading=0.2,
    weight_change=30.0,
    position_scale=0.02,
    heading_scale=0.2,
)
# obstacles that the scripted controller does not always cross
_HARD = ("step up", "stairs up", "beams")
# training should not spend time on robots that are stuck
_LIMITS = Limits(time=20.0, stuck_time=3.0)


@dataclass(frozen=True)
class LearningTask:
    """An environment to learn in."""

    robots: Any
    """The vector environment, with the interface of Stable-Baselines3; its actions are
    corrections.
    """
    policy: Callable[[Network], Policy]
    """Makes the policy from a trained network."""
    env: Any
    """The environment that `robots` wraps, which describes the observations and actions."""
    deviation: float
    """Natural logarithm of the actions' initial standard deviation."""
    robot: str
    """The robot's name or file."""
    drive: Drive
    """The robot's motors."""


def learning_task(config: Config) -> LearningTask:
    """The learning task for `config.env`; raises TrackslipError if Stable-Baselines3 isn't
    installed.
    """
    # late, as PyTorch takes seconds
    from sim.sb3 import Corrections, PathTrackingVecEnv, TraverseVecEnv

    find_own_modules()
    if config.env == TRAVERSE:
        robot = config.robot or "rescue"
        options = {**OPTIONS, "robot": robot, "course": list(config.courses)}
        courses = {
            "difficulty": config.difficulty,
            "kinds": _HARD,
            "obstacles": 1,
            "limits": _LIMITS,
            "own_rewards": config.own_rewards,
        }
        crossing = TraverseVecEnv(config.robots, config.threads, **options, **courses)
        drive = or_tireless(crossing.env.task.world.tracked.robot.drive)
        return LearningTask(
            crossing, lambda network: Policy(network, options), crossing.env, -1.0, robot, drive
        )
    robot = config.robot or SHIPPED
    parameters, _ = load_parameters(robot)
    plants = plant_ranges(parameters)
    robots = PathTrackingVecEnv(
        config.robots,
        config.threads,
        robot=parameters,
        reference=config.references,
        ground=config.grounds,
        action="twist",
        compensation=config.compensation,
        laws=config.laws and str(config.laws),
        pose_source="noisy",
        reward=_REWARD,
        own_rewards=config.own_rewards,
        randomization=replace(plants, start_distance=_START_DISTANCE, start_heading=_START_HEADING),
    )
    corrected = Corrections(robots, config.authority)
    options = {"action": "twist"}
    return LearningTask(
        corrected,
        lambda network: TrackingPolicy(network, options, config.authority),
        robots.env,
        -1.2,
        robot,
        or_tireless(parameters.drive),
    )
