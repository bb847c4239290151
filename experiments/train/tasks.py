"""The environments that `trackslip train` learns in, and their policies."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any, Final

from experiments.benchmark.cases import plant_ranges
from experiments.common.lookup import find_own_modules
from experiments.train.config import TRAVERSE, Config
from sim.motors.motor import Drive, or_tireless
from sim.path_tracking.config import EnvConfig, TrackingReward
from sim.policy import Network, Policy, TrackingPolicy
from sim.robot.named import SHIPPED
from sim.traverse.outcome import Limits
from sim.traverse.policy import OPTIONS

# ranges of errors at the start
_START_DISTANCE: Final = (0.0, 0.2)  # [m]
_START_HEADING: Final = (-0.4, 0.4)  # [rad]
_REWARD: Final = TrackingReward(
    weight_position=0.8,
    weight_heading=0.2,
    weight_change=30.0,
    position_scale=0.02,
    heading_scale=0.2,
)
# obstacles that the scripted controller does not always cross
_HARD: Final = ("step up", "stairs up", "beams")
# training should not spend time on robots that are stuck
_LIMITS: Final = Limits(time=20.0, stuck_time=3.0)


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
    find_own_modules()
    return _crossing(config) if config.env == TRAVERSE else _path_tracking(config)


def _crossing(config: Config) -> LearningTask:
    """Crossing courses with a tracked robot with flippers."""
    from sim.sb3 import TraverseVecEnv  # late, as PyTorch takes seconds

    robot = config.robot or "rescue"
    options = {**OPTIONS, "robot": robot, "course": list(config.courses)}
    robots = TraverseVecEnv(
        config.robots,
        config.threads,
        **options,
        difficulty=config.difficulty,
        kinds=_HARD,
        obstacles=1,
        limits=_LIMITS,
        own_rewards=config.own_rewards,
    )
    return LearningTask(
        robots=robots,
        policy=lambda network: Policy(network, options),
        env=robots.env,
        deviation=-1.0,
        robot=robot,
        drive=or_tireless(robots.env.task.world.tracked.robot.drive),
    )


def _path_tracking(config: Config) -> LearningTask:
    """Following paths with a shipped or a user's robot."""
    from sim.sb3 import Corrections, PathTrackingVecEnv  # late, as PyTorch takes seconds

    robot = config.robot or SHIPPED
    world = EnvConfig(robot=robot, ground=config.grounds)
    plants = plant_ranges(world.parameters)
    if world.is_soft:
        plants = plants.on_soft_soil()
    robots = PathTrackingVecEnv(
        config.robots,
        config.threads,
        robot=robot,
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
    options = {"action": "twist"}
    return LearningTask(
        robots=Corrections(robots, config.authority),
        policy=lambda network: TrackingPolicy(network, options, config.authority),
        env=robots.env,
        deviation=-1.2,
        robot=robot,
        drive=or_tireless(world.parameters.drive),
    )
