import warnings

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env, data_equivalence

from sim.env import PathTrackingEnv
from sim.fleet import Fleet
from sim.ground.ground import Ground
from sim.path_tracking.config import EnvConfig, Reward
from sim.path_tracking.randomization import Randomization
from sim.path_tracking.tracking import TERMS
from sim.robot.parameters import RobotParameters
from sim.run_recorder import Description
from sim.runs import closed_loop
from sim.scanner.feed import ScannerFeed
from sim.scanner.scanner import LaserScanner
from sim.steering import Pilot
from sim.task_env import from_options
from trackslip.controllers.linear import LinearTimeVarying
from trackslip.errors import InvalidValueError
from trackslip.kinematics import wrap_angle
from trackslip.metrics import tracking_errors
from trackslip.slip.compensation import FixedLaw
from trackslip.slip.exponential import PUBLISHED
from trackslip.slip.law_file import load_laws
from trackslip.trajectory.named import named_reference

ID = "sim:trackslip/PathTracking-v0"
VARIANTS = [
    {},
    {"action": "twist"},
    {"action": "twist", "compensation": "icr_radius", "pose_source": "noisy"},
    {"action": "twist", "compensation": PUBLISHED, "previews": 0},
    {"pose_source": "noisy", "randomization": "typical"},
    {"pose_source": "scanner", "randomization": "typical", "reference": ("circle", "slalom")},
]


@pytest.mark.parametrize("options", VARIANTS)
def test_gymnasium_finds_no_fault(options):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        check_env(gym.make(ID, **options).unwrapped, skip_render_check=True)


def drive(env, seed=0, steps=50, **options):
    env.action_space.seed(seed)
    results = [env.reset(seed=seed, options=options)]
    for _ in range(steps):
        results.append(env.step(env.action_space.sample()))
    return results


@pytest.mark.parametrize("options", VARIANTS)
def test_an_episode_follows_from_its_seed(options):
    env = gym.make(ID, **options)
    first, second, other = drive(env, 3), drive(env, 3), drive(gym.make(ID, **options), 3)
    for again in (second, other):
        assert all(data_equivalence(a, b, exact=True) for a, b in zip(first, again, strict=True))


def test_keys_of_info_are_always_the_same():
    results = drive(gym.make(ID))
    keys = set(results[0][-1])
    assert all(set(result[-1]) == keys for result in results)
    assert {f"reward_{term}" for term in TERMS} < keys


def test_observations_of_a_known_case():
    env = gym.make(ID, previews=2, preview_spacing=0.5, reference="circle").unwrapped
    observation, info = env.reset(seed=0, options={"start_error": (-0.1, 0.2, 0.5)})
    # it starts at constant speed; the robot is behind, to the left and turned to the left
    cos, sin = np.cos(0.5), np.sin(0.5)
    error = np.array([cos * 0.1 - sin * 0.2, -sin * 0.1 - cos * 0.2])
    expected = [*error / 0.5, -0.5 / np.pi, *[0.15 / 0.3, 0.15 / 1.0] * 3, 0, 0, 0, 0]
    np.testing.assert_allclose(observation, expected, atol=1e-6)
    np.testing.assert_allclose(info["true_error"], [*error, -0.5], atol=1e-9)
    assert info["true_slip"].tolist() == [0, 0]
    for _ in range(20):
        observation, *_, info = env.step(np.array([0.5, 0.4], np.float32))
    np.testing.assert_allclose(observation[-2:], [0.5, 0.4], atol=1e-6)
    np.testing.assert_allclose(observation[-4:-2], [0.5, 0.4], atol=1e-3)
    np.testing.assert_allclose(info["measured_omega"], [2.5, 2.0], atol=2e-3)
    assert info["time"] == pytest.approx(1.0)
    assert 0 < info["true_slip"][0] < 0.5


def test_a_reference_ends_with_truncation_and_leaving_it_with_termination():
    env = gym.make(ID, reference="circle", action="twist", compensation="icr_radius")
    env.reset(seed=0)
    reference = named_reference("circle")
    steps, ended = 0, False
    while not ended:
        _, _, terminated, ended, info = env.step(np.array([0.5, 0.15], np.float32))
        steps += 1
        assert not terminated
    assert steps == np.ceil(reference.duration / 0.05)
    assert info["success"]
    env.reset(seed=0)
    while not terminated:
        before = info
        _, reward, terminated, truncated, info = env.step(np.zeros(2, np.float32))
        assert not truncated
    assert np.hypot(*before["true_error"][:2]) <= 0.5 < np.hypot(*info["true_error"][:2])
    assert reward < -8
    assert info["reward_termination"] == -10
    assert not info["success"]


def test_rewards_are_the_sum_of_their_terms():
    weights = Reward(weight_position=2.0, heading_scale=0.1)
    env = gym.make(ID, reward=weights, reference="slalom").unwrapped
    results = drive(env, steps=60, start_error=(0.1, 0.1, 0.2))
    previous = np.zeros(2)
    env.action_space.seed(0)
    for _, reward, _, _, info in results[1:]:
        action = env.action_space.sample().astype(float)
        x, y, phi = info["true_error"]
        place, turn = (x**2 + y**2) / 0.05**2, (phi / 0.1) ** 2
        assert info["reward_alive"] == 1
        assert info["reward_position"] == pytest.approx(-2 * place / (1 + place))
        assert info["reward_heading"] == pytest.approx(-0.2 * turn / (1 + turn))
        assert info["reward_change"] == pytest.approx(-0.1 * np.mean((action - previous) ** 2) / 4)
        assert reward == pytest.approx(sum(info[f"reward_{term}"] for term in TERMS))
        previous = action


def test_an_action_arrives_after_the_latency():
    env = gym.make(ID)
    for latency in (0, 1, 2):
        env.reset(seed=0, options={"latency": latency})
        arrived = [env.step(np.array([0.2, 0.2], np.float32))[-1]["set_point"][0] for _ in range(4)]
        np.testing.assert_allclose(arrived, [0.0] * latency + [1.0] * (4 - latency), atol=1e-6)


@pytest.mark.parametrize("bad", [[np.nan, 0.0], [0.0, np.inf], [0.0], [[0.0, 0.0]]])
def test_actions_that_are_no_actions_are_refused(bad):
    env = gym.make(ID).unwrapped
    env.reset(seed=0)
    with pytest.raises(InvalidValueError, match="action"):
        env.step(np.array(bad))


def test_episodes_differ_within_their_ranges():
    drawn = Randomization.typical()
    env = PathTrackingEnv(reference=("paper", "circle"), ground=("stone", "ice"), randomization=drawn)
    episodes = [env.task.draw(np.random.default_rng(seed), {}) for seed in range(200)]
    settings = [episode.setting for episode in episodes]
    for name, low, high in (("radius_error", *drawn.radius_error), ("lag", *drawn.lag)):
        values = [getattr(setting, name) for setting in settings]
        assert low <= min(values) < low + 0.1 * (high - low)
        assert high - 0.1 * (high - low) < max(values) <= high
    assert {episode.latency for episode in episodes} == {0, 1, 2}
    assert {episode.reference for episode in episodes} == {0, 1}
    assert {len(setting.ground.patches) for setting in settings} == {0, 1, 2, 3}
    assert {setting.ground.along for setting in settings} == {0.70, 0.12}
    assert max(setting.ground.slope for setting in settings) > 0.08
    for setting, episode in zip(settings, episodes, strict=True):
        start = env.task.table.path(episode.reference)[0]
        assert np.hypot(*(np.array(setting.start) - start)[:2]) <= 0.2
        assert abs(wrap_angle(setting.start[2] - start[2])) <= 0.3


def test_options_ask_for_what_is_not_to_be_drawn():
    env = PathTrackingEnv(randomization="typical")
    ground = Ground(0.4, 0.6)
    _, info = env.reset(seed=1, options={"ground": ground, "start_error": (0, 0, 0), "com": (0.01, 0.0)})
    np.testing.assert_allclose(info["friction"], [0.4, 0.6])
    np.testing.assert_allclose(info["true_error"], 0, atol=1e-9)
    for options, message in (
        ({"grund": "ice"}, "grund"),
        ({"ground": "mud"}, "mud"),
        ({"reference": "moon"}, "moon"),
        ({"latency": 3}, "latency"),
        ({"lag": -1.0}, "lag"),
        ({"start_error": (0, np.nan, 0)}, "start_error"),
        ({"start_error": 1.0}, "start_error"),
        ({"com": (1.0, 0.0)}, "com_x"),
        ({"radius_error": 2.0}, "radius_error"),
        ({"ground": Ground(0.2, 0.2, slope=0.3)}, "slope"),
    ):
        with pytest.raises(InvalidValueError, match=message):
            env.reset(options=options)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"action": "torque"}, "action = 'torque'"),
        ({"pose_source": "gps"}, "pose_source"),
        ({"reference": "moon"}, "moon"),
        ({"reference": ()}, "reference"),
        ({"ground": "mud"}, "mud"),
        ({"action": "twist", "compensation": "magic"}, "compensation = 'magic'"),
        ({"previews": -1}, "previews"),
        ({"preview_spacing": 0.12}, "preview_spacing"),
        ({"off_path": 0.0}, "off_path"),
        ({"randomization": "wild"}, "randomization"),
        ({"randomization": Randomization(start_distance=(0.0, 0.6))}, "start_distance"),
        ({"randomization": Randomization(com_x=(-0.1, 0.1))}, "com_x"),
        ({"position_noise": -1.0}, "position_noise"),
        ({"twist_scale": (0.3, 0.0)}, "twist_scale"),
        ({"speed": 1.0}, "option = 'speed'"),
        ({"render_mode": "ascii"}, "render_mode"),
    ],
)
def test_what_makes_no_sense_is_refused(options, message):
    with pytest.raises(InvalidValueError, match=message):
        PathTrackingEnv(**options)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: Randomization(slope=(0.2, 0.1)), "slope"),
        (lambda: Randomization(friction_ratio=(0.0, 1.0)), "friction_ratio"),
        (lambda: Randomization(latency=(0, 3)), "latency"),
        (lambda: Randomization(patches=(0, 1.5)), "patches"),
        (lambda: Reward(position_scale=0.0), "position_scale"),
        (lambda: Reward(weight_change=-1.0), "weight_change"),
    ],
)
def test_ranges_and_weights_are_checked(make, message):
    with pytest.raises(InvalidValueError, match=message):
        make()


def test_another_robot_and_pictures_of_it():
    config = from_options(EnvConfig, {"robot": RobotParameters(half_gauge=0.2), "reference": ["paper", "circle"]})
    assert config.references == ("paper", "circle")
    env = PathTrackingEnv(robot=RobotParameters(half_gauge=0.2))
    assert env.task.fleet.robot.geometry.half_gauge == 0.2


def test_a_controller_keeps_the_path_as_it_does_elsewhere(robot):
    """The classical controller of the closed loop, through the environment's eyes and hands."""
    reference, law = named_reference("paper"), load_laws()["icr_radius"]
    fleet = Fleet(robot, reference.pose([0.0]))
    feed = ScannerFeed(LaserScanner(), fleet, [np.random.default_rng(0)])
    pilot = Pilot(LinearTimeVarying(), [0], FixedLaw(law))
    log = closed_loop(fleet, [pilot], reference, feed, None, [Description("run")])[0]
    env = gym.make(ID, action="twist", compensation="icr_radius")
    _, info = env.reset(seed=0)
    poses, ended = [info["true_pose"]], False
    while not ended:
        twist = LinearTimeVarying().twist(info["time"], info["measured_pose"], reference)
        _, _, terminated, ended, info = env.step((twist / [0.3, 1.0]).astype(np.float32))
        assert not terminated
        poses.append(info["true_pose"])
    np.testing.assert_allclose(np.array(poses), log.truth.pose, atol=1e-4)  # but for settling and float32
    elsewhere, here = (tracking_errors(log.time, p, reference) for p in (log.truth.pose, np.array(poses)))
    assert here.rms_position == pytest.approx(elsewhere.rms_position, rel=0.02)


def test_ground_that_shears_is_named_or_drawn():
    env = PathTrackingEnv(ground=("stone", "clay"), randomization=Randomization(shear=(0.005, 0.02)))
    for seed in range(3):
        env.reset(seed=seed)
        env.step(np.ones(2, np.float32))
    plain = PathTrackingEnv()
    with pytest.raises(InvalidValueError, match=r"ground\.shear = 0\.006: must be 0 in an environment"):
        plain.reset(seed=0, options={"ground": "clay"})
    with pytest.raises(InvalidValueError, match="shear"):
        Randomization(shear=(0.0, 0.3))
