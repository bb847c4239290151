"""Both environments through gymnasium: its checker, seeds, and rows of the batch that are the single environment."""

import itertools
import sys
from dataclasses import fields
from functools import partial

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env
from gymnasium.vector import AutoresetMode, SyncVectorEnv
from gymnasium.wrappers.vector import NormalizeObservation, NormalizeReward, RecordEpisodeStatistics
from results import assert_same

from sim.drive.drive import Drive
from sim.drive.motor import Motor
from sim.drive.pull import Pull
from sim.env import PathTrackingVectorEnv, TraverseVectorEnv
from sim.fleet import Setting
from sim.path_tracking.config import EnvConfig, Reward
from sim.path_tracking.randomization import Randomization
from sim.robot.named import ROBOTS, load_tracked
from sim.robot.parameters import RobotParameters
from sim.scanner.scanner import LaserScanner
from sim.task import from_options
from sim.terrain import Course, Flat, Ramp, Step
from sim.traverse.config import Reward as TraverseReward
from sim.traverse.config import TraverseConfig
from sim.traverse.observation import SensorNoise
from sim.traverse.outcome import Limits
from sim.traverse.reflex import Reflex
from sim.traverse.servos import Servos
from trackslip.errors import InvalidValueError, TrackslipError
from trackslip.laws.exponential import PUBLISHED
from trackslip.laws.file import load_laws, save_laws
from trackslip.laws.icr_load import IcrLoad

TRACKING, TRAVERSE = "sim:trackslip/PathTracking-v0", "sim:trackslip/Traverse-v0"
TWIST = {"action": "twist", "compensation": "icr_radius"}
UNDER_LOAD = IcrLoad(0.035, 0.168, 0.004, compliance=0.085, turn_compliance=0.2)
DRAWN = {
    "reference": ("paper", "slalom", "stop_and_go"),
    "ground": ("stone", "gravel"),
    "randomization": "typical",
    "off_path": 0.22,
}
LEARNING = {"action": "twist", "compensation": "online_load", "loads": True, "pull": Pull(10.0, since=1.0)}
COARSE = {"pose_source": "scanner", "scanner": LaserScanner(resolution=0.01, dropout=0.05)}
VARIANTS = [
    (TRACKING, {}),
    (TRACKING, TWIST | {"pose_source": "noisy", "randomization": "typical"}),
    (TRACKING, {"action": "twist", "compensation": PUBLISHED, "previews": 0}),
    (TRACKING, {"action": "twist", "compensation": UNDER_LOAD, "randomization": "typical"}),
    (TRACKING, {"pose_source": "scanner", "randomization": "typical", "reference": ("circle", "slalom")}),
    (TRACKING, TWIST | COARSE | {"compensation": "online", "randomization": "typical"}),
    (TRACKING, LEARNING | {"compensation": "online_cold", "ground": "clay"}),
    (TRAVERSE, {}),
    (TRAVERSE, {"action": "correction", "flippers": "pairs", "period": 0.2}),
    (TRAVERSE, {"course": ("random", "step10", "rough"), "kinds": ("gap",)}),
    (TRAVERSE, {"robot": "box", "course": Course((Flat(0.5), Step(0.05)))}),
]


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize(("name", "options"), VARIANTS)
def test_gymnasium_finds_no_fault(name, options):
    check_env(gym.make(name, **options).unwrapped, skip_render_check=True)


@pytest.fixture(scope="module")
def laws(tmp_path_factory):
    """Options with a file of laws, among them that of `online_load`."""
    file = tmp_path_factory.mktemp("laws") / "laws.json"
    save_laws(file, load_laws() | {"icr_load": UNDER_LOAD}, RobotParameters().geometry)
    return {"laws": file}


SHORT = {"limits": Limits(time=1.2, stuck_time=0.4), "course": ("random", "rough"), "period": 0.2}


@pytest.mark.parametrize(
    ("name", "options", "mode"),
    [
        *((TRACKING, DRAWN, mode) for mode in AutoresetMode),
        (TRACKING, DRAWN | {"pose_source": "scanner"}, AutoresetMode.SAME_STEP),  # most to restart
        *(
            pytest.param(TRACKING, DRAWN | {"pose_source": "scanner"}, mode, marks=pytest.mark.slow)
            for mode in (AutoresetMode.NEXT_STEP, AutoresetMode.DISABLED)
        ),
        (TRACKING, DRAWN | TWIST | {"pose_source": "noisy"}, AutoresetMode.SAME_STEP),
        (TRACKING, DRAWN | TWIST | {"compensation": UNDER_LOAD}, AutoresetMode.NEXT_STEP),
        (TRACKING, DRAWN | TWIST | COARSE | {"compensation": "online"}, AutoresetMode.SAME_STEP),
        *((TRACKING, DRAWN | LEARNING | {"pose_source": "noisy"}, mode) for mode in AutoresetMode),
        *((TRACKING, DRAWN | {"max_episode_steps": 13}, mode) for mode in AutoresetMode),
        (TRAVERSE, {"period": 0.2, "max_episode_steps": 4}, AutoresetMode.NEXT_STEP),
        (TRAVERSE, SHORT, AutoresetMode.NEXT_STEP),
        (TRAVERSE, SHORT, AutoresetMode.SAME_STEP),
    ],
)
def test_a_row_is_the_single_environment_to_the_bit(name, options, mode, laws, tmp_path):
    file = tmp_path / "short.csv"
    file.write_text("x,y\n0,0\n0.1,0\n0.2,0.02\n")  # of a few seconds, so that an episode comes to its end
    if name == TRACKING:
        options = options | laws | {"reference": (*options["reference"], str(file))}
    native = gym.make_vec(name, num_envs=3, autoreset_mode=mode, threads=2, **options)
    single = gym.make_vec(name, 3, vectorization_mode="sync", vector_kwargs={"autoreset_mode": mode}, **options)
    assert isinstance(native, PathTrackingVectorEnv | TraverseVectorEnv)
    assert isinstance(single, SyncVectorEnv)
    for space in ("observation_space", "action_space", "metadata"):
        assert getattr(native, space) == getattr(single, space)
    assert_same(native.reset(seed=7), single.reset(seed=7))
    single.action_space.seed(3)
    ends = 0
    for _ in range(9 if name == TRAVERSE else 80):
        actions = single.action_space.sample()
        if name == TRAVERSE:
            actions[0] = -1.0, 1.0, 0.0, 0.0, 0.0, 0.0  # turns on the spot until its time is over
        results = native.step(actions), single.step(actions)
        assert_same(*results)
        ended = results[0][2] | results[0][3]
        ends += ended.sum()
        if mode is AutoresetMode.DISABLED and ended.any():
            assert_same(*(env.reset(options={"reset_mask": ended.copy()}) for env in (native, single)))
    assert ends >= 1
    native.close()
    single.close()


def physical(elements, values):
    """Values of elements in their units, by name."""
    assert len(elements) == len(values)
    return {element.name: element.scale * value for element, value in zip(elements, values, strict=True)}


def test_scales_turn_observations_and_actions_into_quantities():
    env = gym.make(TRACKING, action="twist", reference="circle", off_path=0.3).unwrapped
    env.reset(seed=0, options={"start_error": (-0.06, 0.02, 0.1)})
    action = np.array([0.5, -0.4], np.float32)
    for _ in range(20):
        observation, *_, info = env.step(action)
    seen, said = physical(env.observed, observation), physical(env.commanded, action)
    assert [seen["position error, ahead"], seen["position error, to the left"], seen["heading error"]] == pytest.approx(
        info["true_error"], rel=1e-5
    )
    sprockets = [seen[f"{side} sprocket speed"] for side in ("left", "right")]
    np.testing.assert_allclose(sprockets, info["measured_omega"], rtol=1e-5)
    geometry = env.task.fleet.robot.geometry
    radius, b = geometry.sprocket_radius, geometry.half_gauge
    tracks = np.array([said["speed"] - b * said["yaw rate"], said["speed"] + b * said["yaw rate"]])
    np.testing.assert_allclose(info["set_point"], tracks / radius, rtol=1e-6)
    expected = np.array([element.bound for element in env.observed], np.float32)
    np.testing.assert_array_equal(env.observation_space.high, expected)

    env = gym.make(TRAVERSE, course="step10", flippers="pairs").unwrapped
    env.reset(seed=0)
    action = np.array([0.5, 0.4, 0.3, -0.2], np.float32)
    for _ in range(15):
        observation, *_ = env.step(action)
    seen, said = physical(env.observed, observation), physical(env.commanded, action)
    world = env.task.world
    for k, side in enumerate(("left", "right")):
        assert seen[f"{side} belt speed"] == pytest.approx(said[f"{side} belt speed, set point"], rel=0.01)
        assert seen[f"front_{side}_flipper set point"] == pytest.approx(said["front flippers, set point"])
        angles = world.tracked.flipper_angles(world.state.qpos)[0]
        assert seen[f"rear_{side}_flipper angle"] == pytest.approx(angles[2 + k], rel=1e-5)
    place = world.state.position[:, None, :2]
    below = world.elevation(place)[0, 0] - world.state.position[0, 2] - world.tracked.robot.lowest
    assert seen["height at (0, 0) m"] == pytest.approx(below, abs=1e-6)


def test_a_robot_may_come_from_a_file_with_its_ground(tmp_path):
    file = tmp_path / "robot.toml"
    file.write_text("mass = 20.0\n[ground]\nalong = 0.5\nacross = 0.6\n")
    for robot in (str(file), file):
        env = gym.make(TRACKING, robot=robot, ground="robot").unwrapped
        env.reset(seed=0)
        (ground,) = env.task.fleet.ground
        assert (env.task.fleet.robot.mass, ground.along, ground.across) == (pytest.approx(20.0), 0.5, 0.6)


def test_a_robot_brings_its_own_drive_unless_another_is_given(tmp_path):
    file = tmp_path / "robot.toml"
    file.write_text("[drive]\nlag = 0.2\ntop_speed = 0.4\n[drive.motor]\nfriction = 0.1\n")
    own = Drive(lag=0.2, top_speed=0.4, motor=Motor(friction=0.1))
    for given, expected in ((None, own), (Drive(lag=0.1), Drive(lag=0.1))):
        env = gym.make(TRACKING, robot=file, drive=given).unwrapped
        env.reset(seed=0)
        assert env.task.fleet.drive.drive == expected
        for _ in range(4):
            env.step(np.ones(2, np.float32))
        fastest = expected.top_speed / 0.06
        np.testing.assert_allclose(env.task.fleet.drive.omega, fastest * -np.expm1(-0.2 / expected.lag), rtol=1e-9)
    fleet = env.task.fleet
    fleet.restart([0], [Setting((0.0, 0.0, 0.0))])  # whose lag is the drive's own
    fleet.command([3.0, 3.0])
    fleet.advance(0.1)
    np.testing.assert_allclose(fleet.drive.omega, -3.0 * np.expm1(-1.0), rtol=1e-9)


@pytest.mark.parametrize("name", [TRACKING, TRAVERSE])
@pytest.mark.parametrize("robot", [*ROBOTS, RobotParameters(half_gauge=0.25, contact_length=0.5), load_tracked("box")])
def test_both_environments_take_any_robot(name, robot):
    env = gym.make(name, robot=robot).unwrapped
    env.reset(seed=0)
    info = env.step(np.full(env.action_space.shape, 0.5, np.float32))[-1]
    place = "true_pose" if name == TRACKING else "true_position"
    assert np.isfinite(info[place]).all()


@pytest.mark.parametrize("display", ["", ":0"])
def test_windows_are_offered_where_there_is_a_display(display, monkeypatch):
    monkeypatch.setattr(sys, "platform", "linux")
    monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)
    monkeypatch.setenv("DISPLAY", display)
    env = gym.make(TRAVERSE, period=0.2)
    assert env.metadata["render_modes"] == ["rgb_array", *(["human"] if display else [])]
    assert env.metadata["render_fps"] == 5


@pytest.mark.parametrize("name", [TRACKING, TRAVERSE])
def test_gymnasiums_wrappers_see_the_same_episodes_in_a_batch(name):
    episodes = []
    for mode in ("vector_entry_point", "sync"):
        envs = gym.make_vec(name, num_envs=3, vectorization_mode=mode, max_episode_steps=6)
        envs = NormalizeReward(NormalizeObservation(RecordEpisodeStatistics(envs)))
        envs.reset(seed=4)
        actions = np.random.default_rng(1).uniform(-1.0, 1.0, (20, *envs.action_space.shape)).astype(np.float32)
        results = [envs.step(action) for action in actions]
        lengths = np.concatenate([info["episode"]["l"] for *_, info in results if "episode" in info])
        episodes.append([*results[-1][:4], lengths])
        envs.close()
    assert_same(*episodes)
    assert set(lengths) == {6}


def test_seeds_may_be_one_each():
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
    assert [rng.random() for rng in native.np_random] == [rng.random() for rng in single.np_random]


@pytest.mark.parametrize(
    ("name", "options"),
    [
        (TRAVERSE, {"reward": TraverseReward(weight_energy=0.01), "noise": SensorNoise(height=0.1)}),
        (TRAVERSE, {"difficulty": (0.1, 0.2), "course": ("step10", Course((Flat(0.5), Step(0.05), Ramp(0.2, 1.0))))}),
        (TRAVERSE, {"limits": Limits(time=3.0), "servos": Servos(), "robot": "box"}),
        (TRACKING, {"randomization": Randomization.typical(), "drive": Drive(lag=0.1), "robot": RobotParameters()}),
        (TRACKING, TWIST | {"compensation": PUBLISHED, "scanner": LaserScanner(noise=0.01), "pull": Pull(1.0)}),
    ],
)
def test_specifications_round_trip_as_json_and_unknown_options_are_type_errors(name, options):
    made = gym.make(name, **options)
    again = gym.make(gym.envs.registration.EnvSpec.from_json(made.spec.to_json()))
    assert again.unwrapped.task.config == made.unwrapped.task.config
    with pytest.raises(TypeError, match="unexpected keyword argument 'wrong': options are "):
        gym.make(name, wrong=1)


@pytest.mark.parametrize("vector", [False, True])
def test_difficulty_and_randomization_change_between_episodes(vector):
    make = partial(gym.make_vec, num_envs=2) if vector else gym.make
    crossing = make(TRAVERSE, difficulty=(0.0, 0.0)).unwrapped
    crossing.set_difficulty(0.6, 0.6)
    assert np.all(crossing.reset(seed=0)[1]["difficulty"] == 0.6)
    tracking = make(TRACKING).unwrapped
    tracking.reset(seed=0)
    before = tracking.get_state()
    tracking.set_randomization({"radius_error": (0.2, 0.2)})
    tracking.reset(seed=0)
    radius = RobotParameters().sprocket_radius
    np.testing.assert_allclose(tracking.task.fleet.drive.radius, 1.2 * radius)
    with pytest.raises(InvalidValueError, match="shear"):
        tracking.set_randomization(Randomization(shear=(0.0, 0.01)))
    tracking.set_state(before)
    assert tracking.task.config.randomization is None


def test_options_may_be_one_each_and_none_is_drawn():
    env = gym.make_vec(TRACKING, num_envs=2, **DRAWN)
    radius = env.unwrapped.task.fleet.robot.geometry.sprocket_radius
    env.reset(seed=3)
    drawn = env.unwrapped.task.fleet.drive.radius.copy()
    env.reset(seed=3, options={"radius_error": [None, 0.2], "ground": [None, "ice"]})
    np.testing.assert_allclose(env.unwrapped.task.fleet.drive.radius, [drawn[0], [1.2 * radius] * 2])
    assert [ground.along for ground in env.unwrapped.task.fleet.ground][1] == 0.12
    with pytest.raises(InvalidValueError, match="radius_error = None"):
        env.reset(options={"radius_error": None})


def test_who_has_ended_must_be_reset_where_nobody_else_does():
    drawn = Randomization(start_distance=(0.1, 0.1))
    env = gym.make_vec(TRACKING, num_envs=2, autoreset_mode="Disabled", off_path=0.11, randomization=drawn)
    with pytest.raises(TrackslipError, match="reset"):
        env.step(np.zeros((2, 2)))
    with pytest.raises(InvalidValueError, match="reset_mask"):
        env.reset(options={"reset_mask": np.array([True, False])})
    env.reset(seed=0)
    ended = np.zeros(2, bool)
    while not ended.any():
        _, _, terminated, truncated, _ = env.step(np.array([[-1.0, -1.0], [0.0, 0.0]]))
        ended = terminated | truncated
    with pytest.raises(TrackslipError, match=r"robots \[0\] have ended"):
        env.step(np.zeros((2, 2)))
    for mask in ([True, False], np.zeros(2, bool), np.ones(3, bool)):
        with pytest.raises(InvalidValueError, match="reset_mask"):
            env.reset(options={"reset_mask": mask})
    _, info = env.reset(options={"reset_mask": ended})
    assert info["_time"].tolist() == [True, False]
    env.step(np.zeros((2, 2)))


@pytest.mark.parametrize("name", [TRACKING, TRAVERSE])
def test_actions_that_make_no_sense_are_refused(name):
    env = gym.make_vec(name, num_envs=2, threads=1)
    env.reset(seed=0)
    count = env.single_action_space.shape[0]
    for actions in (
        np.zeros((2, count + 1)),
        np.zeros(count),
        np.full((2, count), np.nan),
        np.full((2, count), np.inf),
    ):
        with pytest.raises(InvalidValueError, match="action"):
            env.step(actions)


NAN, INF = float("nan"), float("inf")
HOSTILE = [
    *(None, True, NAN, INF, -1.0, 0, 1e308, 1e-308, 10**400, 1j, "", "x", "x" * 100_000, "a\nb", "\0", b"x", object()),
    *((), (NAN, NAN), ("x", "y"), ("a",) * 10_000, [[1.0], [2.0]], {}, np.array([0.1, 0.2]), np.array("x"), np.nan),
]


def refused_in_one_line(function, *args, **kwargs):
    """Whether a function refuses something in one short line; no other error is allowed."""
    try:
        function(*args, **kwargs)
    except TrackslipError as error:
        message = str(error)
    else:
        return False
    assert "\n" not in message
    assert len(message) < 600
    return True


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("configuration", [EnvConfig, Reward, Randomization, TraverseConfig, Limits, Servos, Reflex])
def test_hostile_options_are_accepted_or_refused_in_one_line(configuration):
    tries = list(itertools.product([f.name for f in fields(configuration)], HOSTILE))
    make = (
        partial(from_options, configuration) if "Config" in configuration.__name__ else lambda one: configuration(**one)
    )
    assert sum(refused_in_one_line(make, {name: value}) for name, value in tries) > 0.7 * len(tries)


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("name", [TRACKING, TRAVERSE])
def test_hostile_values_do_no_harm_in_an_environment(name):
    env, envs = gym.make(name).unwrapped, gym.make_vec(name, num_envs=2)
    env.reset(seed=0)
    for value in HOSTILE:
        refused_in_one_line(envs.reset, options=value)
        refused_in_one_line(envs.reset, seed=value)
        assert refused_in_one_line(envs.reset, options={"reset_mask": value})
        refused_in_one_line(env.step, value)
        assert refused_in_one_line(env.set_state, value)
        for option in ("start_error", "radius_error", "com", "lag", "latency", "ground", "start_offset", "difficulty"):
            if not refused_in_one_line(env.reset, options={option: value}):
                observation, reward, *_ = env.step(np.zeros(env.action_space.shape))
                assert np.isfinite(observation).all()
                assert np.isfinite(reward)
        for option in ("num_envs", "threads", "autoreset_mode", "max_episode_steps"):
            refused_in_one_line(gym.make_vec, name, **({"num_envs": 1} | {option: value}))


def test_the_start_is_within_the_limit_of_the_path():
    env = gym.make(TRACKING, off_path=0.3)
    env.reset(seed=0, options={"start_error": (0.2, -0.2, 3.0)})
    with pytest.raises(InvalidValueError, match=r"start_error = 0\.3.*: must be at most 0.3 m, which is off_path"):
        env.reset(seed=0, options={"start_error": (0.3, -0.1, 0.0)})


LONG = {"off_path": 0.5}
ROUGH = {"course": ("random", "rough")}


@pytest.mark.parametrize(
    ("name", "robots", "steps", "options"),
    [
        (TRACKING, 64, 50, DRAWN | LONG),
        (TRACKING, 16, 100, DRAWN | LEARNING | LONG | {"compensation": "online_cold"}),
        (TRAVERSE, 8, 20, ROUGH),
        pytest.param(TRACKING, 64, 15_625, DRAWN | LONG, marks=pytest.mark.slow),  # a million actions
        pytest.param(TRAVERSE, 64, 15_625, ROUGH, marks=pytest.mark.slow),
    ],
)
def test_random_actions_never_leave_the_finite(name, robots, steps, options):
    env = gym.make_vec(name, num_envs=robots, threads=2, **options)
    env.reset(seed=11)
    env.action_space.seed(11)
    for _ in range(steps):
        observation, reward, _, _, info = env.step(env.action_space.sample())
        assert env.observation_space.contains(observation)
        assert np.isfinite(reward).all()
        for key, values in info.items():
            assert values.dtype == object or key.startswith("_") or np.isfinite(values).all(), key
