"""trackslip/Traverse-v0: the interface, and that the rows of the vector environment are the single one."""

import importlib
import warnings

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env, data_equivalence
from gymnasium.vector import AutoresetMode

from sim.network import Network
from sim.task_env import from_options
from sim.terrain import Course, Flat, Rough, Step
from sim.traverse.config import Reward, TraverseConfig
from sim.traverse.outcome import Limits, Outcome
from sim.traverse.policy import CrossingPolicy
from sim.traverse.task import TERMS, Crossing, reward_terms
from trackslip.errors import InvalidValueError, LogError

ID = "sim:trackslip/Traverse-v0"
VARIANTS = [
    {},
    {"action": "correction", "flippers": "pairs", "period": 0.2},
    {"course": ("random", "step10", "rough"), "kinds": ("gap",)},
    {"robot": "box", "course": Course((Flat(0.5), Step(0.05)))},
]


@pytest.mark.parametrize("options", VARIANTS)
def test_gymnasium_finds_no_fault(options):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        check_env(gym.make(ID, **options).unwrapped, skip_render_check=True)


def assert_same(one, two):
    for a, b in zip(one, two, strict=True):
        if isinstance(a, dict):
            assert a.keys() == b.keys()
            for key in a:
                assert data_equivalence(a[key], b[key], exact=True), key
        else:
            np.testing.assert_array_equal(a, b)


@pytest.mark.parametrize("mode", [AutoresetMode.NEXT_STEP, AutoresetMode.SAME_STEP])
def test_a_row_is_the_single_environment_to_the_bit(mode):
    limits = Limits(time=1.2, stuck_time=0.4)
    options = {"course": ("random", "rough"), "limits": limits, "period": 0.2, "autoreset_mode": mode}
    native = gym.make_vec(ID, num_envs=3, threads=2, **options)
    del options["autoreset_mode"]
    sync = {"vectorization_mode": "sync", "vector_kwargs": {"autoreset_mode": mode}}
    single = gym.make_vec(ID, num_envs=3, **sync, **options)
    assert native.observation_space == single.observation_space
    assert native.action_space == single.action_space
    assert native.metadata == single.metadata
    assert_same(native.reset(seed=5), single.reset(seed=5))
    single.action_space.seed(2)
    outcomes = set()
    for _ in range(9):
        actions = single.action_space.sample()
        actions[0] = -1.0, 1.0, 0.0, 0.0, 0.0, 0.0  # turns on the spot until its time is over
        results = native.step(actions), single.step(actions)
        assert_same(*results)
        last = results[0][4].get("final_info", results[0][4])
        outcomes |= set(last["outcome"].tolist())
    assert {"driving", "time"} <= outcomes
    native.close()
    single.close()


def test_an_episode_follows_from_its_seed():
    env = gym.make(ID).unwrapped
    first, other, again = (env.reset(seed=seed) for seed in (1, 2, 1))
    assert data_equivalence(first, again, exact=True)
    assert not np.array_equal(first[0], other[0])
    course = env.task.world.course[0]
    assert env.reset(seed=1)[1]["difficulty"] == first[1]["difficulty"]
    assert env.task.world.course[0] == course


def test_difficulty_and_courses_may_be_given():
    env = gym.make_vec(ID, num_envs=2, threads=1, course=("random", "step10"))
    _, info = env.reset(seed=0, options={"course": ["step10", "random"], "difficulty": 0.25, "start_heading": 0.0})
    np.testing.assert_array_equal(info["difficulty"], [-1.0, 0.25])
    env.task.set_difficulty(0.9, 1.0)
    _, info = env.reset(options={"course": "random"})
    assert (info["difficulty"] >= 0.9).all()
    own = Course((Flat(0.5), Step(0.05)))
    env.reset(options={"course": own})
    assert env.task.world.course[1] is own
    for options, message in (
        ({"course": "moon"}, "course = 'moon'"),
        ({"course": Course((Rough(),))}, "height fields"),
        ({"difficulty": 1.5}, "difficulty = 1.5"),
        ({"start_offset": 9.0}, "start_offset"),
        ({"start_heading": np.nan}, "start_heading"),
        ({"speed": 1.0}, "options = 'speed'"),
    ):
        with pytest.raises(InvalidValueError, match=message):
            env.reset(options=options)
    with pytest.raises(InvalidValueError, match="difficulty"):
        env.set_difficulty(0.5, 0.2)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"course": "moon"}, "moon"),
        ({"course": ()}, "course"),
        ({"difficulty": (0.5, 2.0)}, "difficulty"),
        ({"kinds": ("wall",)}, "kinds = 'wall'"),
        ({"obstacles": 3}, "obstacles = 3"),
        ({"action": "twist"}, "action = 'twist'"),
        ({"flippers": "none"}, "flippers = 'none'"),
        ({"period": 0.03}, "period = 0.03"),
        ({"period": np.nan}, "period = nan"),
        ({"difficulty": 0.5}, "difficulty = 0.5: must be two ascending numbers"),
        ({"robot": "wheeled"}, "robot = 'wheeled'"),
        ({"preset": "exact"}, "preset = 'exact'"),
        ({"friction": 0.5}, "friction"),
        ({"render_mode": "ansi"}, "render_mode"),
    ],
)
def test_options_out_of_range_are_refused(options, message):
    with pytest.raises(InvalidValueError, match=message):
        gym.make_vec(ID, num_envs=1, **options)


def test_actions_that_make_no_sense_are_refused():
    env = gym.make_vec(ID, num_envs=2, threads=1)
    env.reset(seed=0)
    for actions in (np.zeros((2, 3)), np.full((2, 6), np.nan)):
        with pytest.raises(InvalidValueError, match="action"):
            env.step(actions)


def test_the_observation_is_what_it_says():
    env = gym.make(ID, course="step10").unwrapped
    observation, _ = env.reset(seed=0, options={"start_offset": 0.3, "start_heading": 0.1})
    np.testing.assert_allclose(observation[:3], [0, 0, 1], atol=1e-6)
    np.testing.assert_allclose(observation[6:8], [0.3, 0.1 / np.pi], atol=1e-6)
    np.testing.assert_allclose(observation[18:], 0.0, atol=0.01)  # level all around, two millimetres below the tracks
    world = env.task.world
    world.state.qpos[0, 0] = -0.55  # the step of 0.1 m is at x = 0, seen from where columns are 0.1 m apart
    world.state.qpos[0, 3:7] = 1, 0, 0, 0
    heights = env.task.observation()[0, 18:].reshape(3, 15) * 0.3
    np.testing.assert_allclose(heights[:, :11], 0.0, atol=0.003)
    np.testing.assert_allclose(heights[:, 11:], 0.1, atol=0.003)


def test_the_reward_is_the_sum_of_its_terms():
    outcome = np.array([Outcome.DRIVING, Outcome.REACHED, Outcome.TIPPED, Outcome.TIME])
    change = np.array([[1.0, -1.0], [0.0, 0.0], [0.0, 2.0], [0.0, 0.0]])
    terms = reward_terms(Reward(), np.array([0.1, 0.2, 0.0, -0.1]), np.array([10.0, 0.0, 0.0, 0.0]), change, outcome)
    np.testing.assert_allclose(terms["progress"], [0.2, 0.4, 0.0, -0.2])
    np.testing.assert_allclose(terms["energy"], [-0.01, 0, 0, 0])
    np.testing.assert_allclose(terms["change"], [-0.02, 0, -0.04, 0])
    np.testing.assert_allclose(terms["end"], [0, 5, -5, 0])
    env = gym.make(ID).unwrapped
    env.reset(seed=0)
    _, reward, _, _, info = env.step(np.ones(6, np.float32))
    assert reward == pytest.approx(sum(info[f"reward_{name}"] for name in TERMS), abs=1e-12)


def test_corrections_of_zero_are_the_scripted_controller():
    still = CrossingPolicy(Network((np.zeros((63, 4)),), (np.zeros(4),)), {"action": "correction", "flippers": "pairs"})
    task = Crossing(from_options(TraverseConfig, still.options), 1, threads=1)
    other = Crossing(task.config, 1, threads=1)
    for one in (task, other):
        one.begin([0], [one.draw(np.random.default_rng(0), {"difficulty": 0.5})])
    for _ in range(5):
        task.step(still.action(task.observation()))
        other.world.step(other.config.scripted.command(other.world))
        np.testing.assert_array_equal(task.world.state.qpos, other.world.state.qpos)


def test_a_stored_policy_is_the_same(tmp_path):
    rng = np.random.default_rng(0)
    policy = CrossingPolicy(Network((rng.normal(size=(63, 4)),), (rng.normal(size=4),)), {"robot": "box"})
    policy.save(tmp_path / "policy.npz")
    stored, seen = CrossingPolicy.load(tmp_path), rng.normal(size=(3, 63))
    np.testing.assert_array_equal(stored.action(seen), policy.action(seen))
    assert stored.options == {"robot": "box"}
    with pytest.raises(LogError, match="No such file"):
        CrossingPolicy.load(tmp_path / "other.npz")


def fuzz(robots, steps):
    env = gym.make_vec(ID, num_envs=robots, threads=2, course=("random", "rough"))
    env.reset(seed=11)
    env.action_space.seed(11)
    for _ in range(steps):
        observation, reward, _, _, info = env.step(env.action_space.sample())
        assert env.observation_space.contains(observation)
        assert np.isfinite(reward).all()
        for name, values in info.items():
            assert values.dtype == object or name.startswith("_") or np.isfinite(values).all(), name


def test_random_actions_never_leave_the_finite():
    fuzz(8, 20)


@pytest.mark.slow
def test_a_million_random_actions():
    fuzz(64, 15_625)


@pytest.mark.filterwarnings("ignore")  # of drivers
def test_pictures_show_the_robot():
    try:
        importlib.import_module("mujoco.egl").GLContext(8, 8).free()
    except Exception:
        pytest.skip("OpenGL doesn't work here")
    env = gym.make(ID, render_mode="rgb_array").unwrapped
    env.reset(seed=0)
    picture = env.render().astype(int)
    assert picture.shape == (480, 640, 3)
    yellow = (picture[..., 0] > picture[..., 2] + 60) & (picture[..., 1] > picture[..., 2] + 30)
    assert yellow.sum() > 1000
    env.close()
