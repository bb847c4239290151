import subprocess
import sys
from dataclasses import dataclass

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env
from gymnasium.vector import AutoresetMode
from results import assert_same

from sim import (
    Drive,
    Ground,
    LaserScanner,
    Limits,
    Pull,
    Randomization,
    RobotParameters,
    SensorNoise,
)
from sim.learning.environment import FEW_ROBOTS, TaskVectorEnv
from sim.terrain import Course, Flat, Step
from trackslip.errors import InvalidValueError, TrackslipError
from trackslip.laws.exponential import PUBLISHED
from trackslip.laws.icr import IcrLoad

TRACKING = "sim:trackslip/PathTracking-v0"
TRAVERSE = "sim:trackslip/Traverse-v0"
TWIST = {"action": "twist", "compensation": "icr_radius"}
UNDER_LOAD = IcrLoad(0.035, 0.168, 0.004, compliance=0.085, turn_compliance=0.2)
DRAWN = {
    "reference": ("paper", "slalom"),
    "ground": ("stone", "gravel"),
    "randomization": "typical",
    "off_path": 0.22,
}
LEARNING = {
    "action": "twist",
    "compensation": "online_cold",
    "loads": True,
    "pull": Pull(10.0, since=1.0),
}
COARSE = {"pose_source": "scanner", "scanner": LaserScanner(resolution=0.01, dropout=0.05)}


@pytest.mark.parametrize(
    ("name", "options"),
    [
        (TRACKING, TWIST | {"pose_source": "noisy", "randomization": "typical", "previews": 0}),
        (TRACKING, LEARNING | {"ground": "clay"}),
        (TRAVERSE, {"action": "correction", "flippers": "pairs", "period": 0.2}),
        (TRAVERSE, {"course": ("random", "step10", "rough"), "kinds": ("gap",)}),
    ],
)
def test_gymnasium_finds_no_fault(name, options):
    check_env(gym.make(name, **options).unwrapped, skip_render_check=True)


SHORT = {"limits": Limits(time=1.2, stuck_time=0.4), "course": ("random", "rough"), "period": 0.2}


@pytest.mark.parametrize(
    ("name", "options", "mode"),
    [
        (TRACKING, DRAWN | COARSE, AutoresetMode.SAME_STEP),  # most to restart
        (TRACKING, DRAWN | TWIST | {"compensation": UNDER_LOAD}, AutoresetMode.DISABLED),
        (TRACKING, DRAWN | LEARNING | {"pose_source": "noisy"}, AutoresetMode.NEXT_STEP),
        (TRAVERSE, SHORT | {"max_episode_steps": 4}, AutoresetMode.SAME_STEP),
    ],
)
def test_a_row_is_the_single_environment_to_the_bit(name, options, mode, tmp_path):
    file = tmp_path / "short.csv"
    # of 1.3 s, so that an episode comes to its end
    file.write_text("x,y\n0,0\n0.01,0\n0.02,0.001\n")
    if name == TRACKING:
        options = options | {"reference": ("slalom", str(file))}
    native = gym.make_vec(name, num_envs=2, autoreset_mode=mode, threads=2, **options)
    single = gym.make_vec(
        name, 2, vectorization_mode="sync", vector_kwargs={"autoreset_mode": mode}, **options
    )
    for space in ("observation_space", "action_space", "metadata"):
        assert getattr(native, space) == getattr(single, space)
    assert_same(native.reset(seed=7), single.reset(seed=7))
    single.action_space.seed(3)
    ends = 0
    for _ in range(9 if name == TRAVERSE else 32):
        actions = single.action_space.sample()
        if name == TRAVERSE:
            actions[0] = -1.0, 1.0, 0.0, 0.0, 0.0, 0.0  # turns on the spot until its time is over
        results = native.step(actions)
        assert_same(results, single.step(actions))
        _, _, terminated, truncated, _ = results
        ended = terminated | truncated
        ends += ended.sum()
        if mode is AutoresetMode.DISABLED and ended.any():
            native_again = native.reset(options={"reset_mask": ended.copy()})
            assert_same(native_again, single.reset(options={"reset_mask": ended.copy()}))
    assert ends >= 1


def test_seeds_and_options_may_be_one_each_and_none_is_drawn():
    native = gym.make_vec(TRACKING, num_envs=3, **DRAWN)
    single = gym.make_vec(TRACKING, num_envs=3, vectorization_mode="sync", **DRAWN)
    assert_same(native.reset(seed=[5, 1, 5]), single.reset(seed=[5, 1, 5]))
    observation, _ = native.reset(seed=[5, None, 5])
    np.testing.assert_array_equal(observation[0], observation[2])
    with pytest.raises(InvalidValueError, match="seed"):
        native.reset(seed=[1, 2])
    for envs in (native, single):
        envs.reset(seed=7)
    assert native.np_random_seed == single.np_random_seed == (7, 8, 9)
    fleet = native.unwrapped.task.fleet
    drawn = fleet.drive.radius.copy()
    native.reset(seed=7, options={"radius_error": [None, 0.2, None], "ground": [None, "ice", None]})
    larger = 1.2 * 0.06
    expected = [drawn[0], [larger, larger], drawn[2]]
    np.testing.assert_allclose(fleet.drive.radius, expected)
    assert fleet.ground[1].along == 0.12
    with pytest.raises(InvalidValueError, match="radius_error = None"):
        native.reset(options={"radius_error": None})


@pytest.mark.parametrize(
    ("name", "options"),
    [
        (
            TRAVERSE,
            {
                "noise": SensorNoise(height=0.1),
                "course": ("step10", Course((Flat(0.5), Step(0.05)))),
            },
        ),
        (
            TRACKING,
            {
                "robot": RobotParameters(mass=30.0, drive=Drive(lag=0.1)),
                "randomization": {"mass": [0.9, 1.1]},
            },
        ),
        (
            TRACKING,
            TWIST
            | {"compensation": PUBLISHED, "scanner": LaserScanner(noise=0.01), "pull": Pull(1.0)},
        ),
    ],
)
def test_specifications_round_trip_and_refuse_unknown_options(name, options):
    made = gym.make(name, **options)
    again = gym.make(gym.envs.registration.EnvSpec.from_json(made.spec.to_json()))
    assert again.unwrapped.task.config == made.unwrapped.task.config
    with pytest.raises(TypeError, match="unexpected keyword argument 'wrong': options are "):
        gym.make(name, wrong=1)


def test_difficulty_and_randomization_change_between_episodes():
    crossing = gym.make_vec(TRAVERSE, num_envs=2, difficulty=(0.0, 0.0)).unwrapped
    crossing.set_difficulty(0.6, 0.6)
    _, info = crossing.reset(seed=0)
    assert np.all(info["difficulty"] == 0.6)
    tracking = gym.make(TRACKING).unwrapped
    tracking.reset(seed=0)
    before = tracking.get_state()
    tracking.set_randomization({"radius_error": (0.2, 0.2)})
    tracking.reset(seed=0)
    larger = 1.2 * RobotParameters().sprocket_radius
    np.testing.assert_allclose(tracking.task.fleet.drive.radius, larger)
    with pytest.raises(InvalidValueError, match="shear"):
        tracking.set_randomization(Randomization(shear=(0.0, 0.01)))
    with pytest.raises(InvalidValueError, match="that of Crossing"):
        tracking.set_state(crossing.unwrapped.get_state())
    tracking.set_state(before)
    assert tracking.task.config.randomization is None


def test_who_has_ended_must_be_reset_where_nobody_else_does():
    drawn = Randomization(start_distance=(0.1, 0.1))
    env = gym.make_vec(
        TRACKING, num_envs=2, autoreset_mode="Disabled", off_path=0.11, randomization=drawn
    )
    with pytest.raises(TrackslipError, match="reset"):
        env.step(np.zeros((2, 2)))
    env.reset(seed=0)
    ended = np.zeros(2, bool)
    while not ended.any():
        _, _, terminated, truncated, _ = env.step(np.array([[-1.0, -1.0], [0.0, 0.0]]))
        ended = terminated | truncated
    with pytest.raises(TrackslipError, match=r"robots \[0\] have ended"):
        env.step(np.zeros((2, 2)))
    with pytest.raises(InvalidValueError, match="reset_mask"):
        env.reset(options={"reset_mask": np.ones(3, bool)})
    _, info = env.reset(options={"reset_mask": ended})
    assert info["_time"].tolist() == [True, False]
    env.step(np.zeros((2, 2)))


NAN = float("nan")
INF = float("inf")


@pytest.mark.parametrize("name", [TRACKING, TRAVERSE])
def test_actions_and_options_that_make_no_sense_are_refused(name):
    envs = gym.make_vec(name, num_envs=2)
    envs.reset(seed=0)
    count = envs.single_action_space.shape[0]
    for actions in (
        np.zeros((2, count + 1)),
        np.zeros(count),
        np.full((2, count), NAN),
        np.full((2, count), INF),
    ):
        with pytest.raises(TrackslipError):
            envs.step(actions)
    for value in (NAN, "x", object(), {}, np.zeros(3)):
        with pytest.raises(TrackslipError):
            envs.reset(options={"reset_mask": value})


ROUGH = {"course": ("random", "rough")}


@dataclass(frozen=True)
class Trial:
    """Robots that take random actions."""

    name: str
    robots: int
    steps: int
    options: dict


TRIALS = [
    pytest.param(Trial(TRACKING, 8, 30, DRAWN | LEARNING | {"off_path": 0.5}), id="tracking"),
    pytest.param(Trial(TRAVERSE, 4, 10, ROUGH), id="traverse"),
    pytest.param(
        Trial(TRACKING, 64, 15_625, DRAWN | {"off_path": 0.5}),
        id="a million actions of tracking",
        marks=pytest.mark.slow,
    ),
    pytest.param(
        Trial(TRAVERSE, 64, 15_625, ROUGH),
        id="a million actions of traverse",
        marks=pytest.mark.slow,
    ),
]


@pytest.mark.parametrize("trial", TRIALS)
def test_random_actions_never_leave_the_finite(trial):
    env = gym.make_vec(trial.name, num_envs=trial.robots, threads=2, **trial.options)
    env.reset(seed=11)
    env.action_space.seed(11)
    for _ in range(trial.steps):
        observation, reward, _, _, info = env.step(env.action_space.sample())
        assert env.observation_space.contains(observation)
        assert np.isfinite(reward).all()
        numbers = {
            key: values
            for key, values in info.items()
            if values.dtype != object and not key.startswith("_")
        }
        for key, values in numbers.items():
            assert np.isfinite(values).all(), key


def test_masses_are_drawn_and_weigh():
    crossing = gym.make_vec(TRAVERSE, num_envs=3, threads=1, course="flat", mass=(0.5, 2.0))
    crossing.reset(seed=0, options={"mass": [1.0, 1.5, None]})
    for _ in range(12):
        *_, info = crossing.step(np.zeros((3, 6), np.float32))
    light, heavy, drawn = info["load"].sum(axis=1)
    assert light == pytest.approx(31.0 * 9.81, rel=0.01)
    assert heavy == pytest.approx((31.0 + 0.5 * 23.8) * 9.81, rel=0.01)  # 23.8 kg are the chassis
    assert abs(drawn - light) > 5
    tracking = gym.make_vec(
        TRACKING, num_envs=2, threads=1, action="twist", randomization=Randomization(mass=(0.5, 2))
    )
    _, info = tracking.reset(seed=0)
    uphill = info["true_pose"][0, 2]
    tracking.reset(seed=0, options={"mass": [1.0, 1.6], "ground": Ground(slope=0.1, uphill=uphill)})
    ahead = np.tile(np.float32([0.5, 0.0]), (2, 1))
    for _ in range(30):
        *_, info = tracking.step(ahead)
    fleet = tracking.unwrapped.task.fleet
    robot = fleet.robot
    chassis = robot.model.body("chassis").mass[0]
    masses = robot.mass + np.array([0.0, 0.6]) * chassis
    needed = masses * 9.81 * np.sin(0.1) * robot.geometry.sprocket_radius
    friction = 2 * fleet.drive.drive.motor.friction
    torque = info["torque"].sum(axis=1)
    np.testing.assert_allclose(torque - friction, needed, rtol=0.05)


CODE = """
import sys
import sim, sim.scanner.scanner, sim.motors.motor, sim.ground.ground, sim.robot.parameters
assert not [module for module in ("mujoco", "scipy", "sim.fleet.fleet") if module in sys.modules]
import gymnasium
for name in ("PathTracking", "Traverse"):
    print(gymnasium.make_vec(f"trackslip/{name}-v0", 2).reset(seed=0)[0].shape)
"""


def test_the_import_registers_environments_without_a_simulator():
    ran = subprocess.run([sys.executable, "-c", CODE], capture_output=True, text=True, check=True)
    assert ran.stdout == "(2, 19)\n(2, 63)\n"


@pytest.mark.parametrize("name", [TRACKING, TRAVERSE])
def test_attributes_and_calls_are_those_of_gymnasiums_vectors(name):
    """Spaces and seeds as in SyncVectorEnv; a method is called once for all robots."""
    batch = gym.make_vec(name, num_envs=2)
    single = gym.make_vec(name, num_envs=2, vectorization_mode="sync")
    for env in (batch, single):
        env.reset(seed=3)
    assert batch.get_attr("observation_space") == single.get_attr("observation_space")
    assert batch.get_attr("action_space") == single.get_attr("action_space")
    assert batch.call("np_random_seed") == single.call("np_random_seed") == (3, 4)
    assert batch.get_attr("task") == (batch.task, batch.task)
    batch.set_attr("note", "kept")
    single.set_attr("note", "kept")
    assert batch.get_attr("note") == single.get_attr("note") == ("kept", "kept")
    batch.set_attr("note", ["again", "again"])
    assert batch.note == "again"
    with pytest.raises(InvalidValueError, match="values = '3 values'"):
        batch.set_attr("note", [1, 2, 3])
    with pytest.raises(InvalidValueError, match="robots of a batch share attributes"):
        batch.set_attr("note", [1, 2])
    with pytest.raises(InvalidValueError, match="name = 'reset'"):
        batch.call("reset", seed=1)
    with pytest.raises(AttributeError):
        batch.get_attr("nothing")


def test_a_call_changes_later_episodes_of_all_robots():
    batch = gym.make_vec(TRAVERSE, num_envs=2)
    batch.call("set_difficulty", 0.7, 0.7)
    _, info = batch.reset(seed=0)
    np.testing.assert_array_equal(info["difficulty"], 0.7)


def test_images_of_a_call_are_those_of_each_robot():
    batch = gym.make_vec(TRACKING, num_envs=2, render_mode="rgb_array")
    batch.reset(seed=0)
    pictures = batch.call("render")
    assert [picture.shape for picture in pictures] == [(480, 640, 3)] * 2


@pytest.mark.parametrize(("robots", "threads"), [(1, 1), (FEW_ROBOTS, 1), (FEW_ROBOTS + 1, 0)])
def test_few_robots_have_one_thread(robots, threads, monkeypatch):
    given = []
    make = TaskVectorEnv._make

    def noted(self, options, size, count, render_mode):
        given.append(count)
        make(self, options, size, count, render_mode)

    monkeypatch.setattr(TaskVectorEnv, "_make", noted)
    gym.make_vec(TRACKING, num_envs=robots)
    assert given == [threads]
