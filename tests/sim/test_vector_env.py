import gymnasium as gym
import numpy as np
import pytest
from gymnasium.utils.env_checker import data_equivalence
from gymnasium.vector import AutoresetMode, SyncVectorEnv

from sim.env import PathTrackingVectorEnv
from sim.ground.ground import Ground
from sim.ground.named import NAMED_GROUNDS
from sim.path_tracking.randomization import Randomization
from trackslip.errors import InvalidValueError, TrackslipError
from trackslip.trajectory.named import REFERENCES

ID = "sim:trackslip/PathTracking-v0"
OPTIONS = {
    "reference": ("paper", "slalom", "stop_and_go"),
    "ground": ("stone", "gravel"),
    "randomization": "typical",
    "off_path": 0.25,
}


@pytest.fixture(scope="module")
def short(tmp_path_factory):
    """A reference of a few seconds, so that episodes come to their end."""
    file = tmp_path_factory.mktemp("paths") / "short.csv"
    file.write_text("x,y\n0,0\n0.1,0\n0.2,0.02\n")
    return str(file)


def pair(n, mode, **options):
    native = gym.make_vec(ID, num_envs=n, autoreset_mode=mode, threads=2, **options)
    scalar = gym.make_vec(ID, num_envs=n, vectorization_mode="sync", vector_kwargs={"autoreset_mode": mode}, **options)
    assert isinstance(native, PathTrackingVectorEnv)
    assert isinstance(scalar, SyncVectorEnv)
    return native, scalar


def assert_same(one, two):
    assert len(one) == len(two)
    for a, b in zip(one, two, strict=True):
        if isinstance(a, dict):
            assert a.keys() == b.keys()
            for key in a:
                assert data_equivalence(a[key], b[key], exact=True), key
        else:
            np.testing.assert_array_equal(a, b)


@pytest.mark.parametrize(
    ("options", "mode"),
    [
        *(({}, mode) for mode in AutoresetMode),
        *(({"pose_source": "scanner"}, mode) for mode in AutoresetMode),  # the most that a reset must restart
        ({"action": "twist", "compensation": "icr_radius"}, AutoresetMode.NEXT_STEP),
        ({"pose_source": "noisy"}, AutoresetMode.SAME_STEP),
    ],
)
def test_a_row_is_the_single_environment_to_the_bit(options, mode, short):
    steps = 80 if "scanner" in options.values() else 120
    references = (*OPTIONS["reference"], short)
    native, scalar = pair(3, mode, **(OPTIONS | {"reference": references, "off_path": 0.22} | options))
    assert native.observation_space == scalar.observation_space
    assert native.action_space == scalar.action_space
    assert native.metadata == scalar.metadata
    assert_same(native.reset(seed=7), scalar.reset(seed=7))
    scalar.action_space.seed(3)
    ends = 0
    for _ in range(steps):
        actions = scalar.action_space.sample()
        results = native.step(actions), scalar.step(actions)
        assert_same(*results)
        ended = results[0][2] | results[0][3]
        ends += ended.sum()
        if mode is AutoresetMode.DISABLED and ended.any():
            again = native.reset(options={"reset_mask": ended}), scalar.reset(options={"reset_mask": ended.copy()})
            assert_same(*again)
    assert ends >= 2
    native.close()
    scalar.close()


def test_seeds_may_be_one_each():
    native, scalar = pair(3, AutoresetMode.NEXT_STEP, **OPTIONS)
    assert_same(native.reset(seed=[5, 1, 5]), scalar.reset(seed=[5, 1, 5]))
    observation, _ = native.reset(seed=[5, None, 5])
    np.testing.assert_array_equal(observation[0], observation[2])
    with pytest.raises(InvalidValueError, match="seed"):
        native.reset(seed=[1, 2])


def test_each_robot_may_have_its_own_ground_and_reference():
    env = gym.make_vec(ID, num_envs=2)
    options = {"ground": [Ground(0.4, 0.5), "ice"], "reference": ["circle", "slalom"], "latency": 1}
    _, info = env.reset(seed=0, options=options)
    np.testing.assert_allclose(info["friction"], [[0.4, 0.5], [0.12, 0.12]])
    np.testing.assert_allclose(info["true_pose"], [[-1.5, 0.4, 0.0], [-3.5, 1.2, info["true_pose"][1, 2]]], atol=1e-9)
    with pytest.raises(InvalidValueError, match="list of 2"):
        env.reset(options={"reference": ["circle"]})


def test_who_has_ended_must_be_reset_where_nobody_else_does():
    drawn = Randomization(start_distance=(0.1, 0.1))
    env = gym.make_vec(ID, num_envs=2, autoreset_mode="Disabled", off_path=0.11, randomization=drawn)
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


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"num_envs": 0}, "num_envs"),
        ({"render_mode": "human"}, "render_mode"),
        ({"threads": -1}, "threads"),
        ({"refrence": "paper"}, "refrence"),
    ],
)
def test_what_makes_no_sense_is_refused(options, message):
    with pytest.raises(InvalidValueError, match=message):
        PathTrackingVectorEnv(**options)


def test_same_bits_at_any_number_of_threads():
    runs = []
    for threads in (1, 2):
        env = gym.make_vec(ID, num_envs=4, threads=threads, **OPTIONS)
        env.reset(seed=1)
        env.action_space.seed(1)
        runs.append([env.step(env.action_space.sample()) for _ in range(60)])
    for one, two in zip(*runs, strict=True):
        assert_same(one, two)


def fuzz(steps):
    env = gym.make_vec(ID, num_envs=64, threads=2, **(OPTIONS | {"off_path": 0.5}))
    env.reset(seed=11)
    env.action_space.seed(11)
    for _ in range(steps // 64):
        observation, reward, _, _, info = env.step(env.action_space.sample())
        assert env.observation_space.contains(observation)
        assert np.isfinite(reward).all()
        assert all(np.isfinite(values).all() for name, values in info.items() if not name.startswith("_"))


def test_random_actions_on_random_grounds():
    fuzz(6_400)


@pytest.mark.slow
def test_a_million_random_actions_on_random_grounds():
    fuzz(1_000_000)


def test_whatever_is_drawn_can_be_parked():
    drawn = Randomization(
        friction_ratio=(0.3, 3.0),
        com_x=(-0.03, 0.03),
        com_y=(-0.06, 0.06),
        slope=(0.0, 1.0),
        patches=(0, 10),
        start_distance=(0.0, 0.4),
        start_heading=(-3.0, 3.0),
    )
    env = PathTrackingVectorEnv(200, reference=tuple(REFERENCES), ground=tuple(NAMED_GROUNDS), randomization=drawn)
    _, info = env.reset(seed=5)
    start = info["true_pose"]
    for _ in range(10):
        *_, info = env.step(np.zeros((200, 2), np.float32))
    assert np.abs(info["true_pose"] - start).max() < 1e-3
