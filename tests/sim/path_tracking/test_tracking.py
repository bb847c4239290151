import numpy as np
import pytest

from sim import (
    Drive,
    Fleet,
    Ground,
    LaserScanner,
    Pilot,
    Pull,
    Randomization,
    RobotParameters,
    closed_loop,
)
from sim.env import PathTrackingEnv, PathTrackingVectorEnv
from sim.ground.ground import NAMED_GROUNDS
from sim.path_tracking.config import EnvConfig, TrackingReward
from trackslip import se2
from trackslip.controllers.feedback import LinearTimeVarying
from trackslip.errors import InvalidValueError
from trackslip.kinematics import wrap_angle
from trackslip.laws.file import load_laws, save_laws
from trackslip.laws.icr import IcrLoad
from trackslip.online.compensation import named_compensation
from trackslip.trajectory.named import REFERENCES, load_reference


def test_episodes_differ_within_their_ranges():
    drawn = Randomization.typical()
    env = PathTrackingEnv(
        reference=("paper", "circle"), ground=("stone", "ice"), randomization=drawn
    )
    episodes = [env.task.draw(np.random.default_rng(seed), {}) for seed in range(200)]
    setups = [episode.setup for episode in episodes]
    for name in ("radius_error", "lag"):
        low, high = getattr(drawn, name)
        values = [getattr(setup, name) for setup in setups]
        tenth = 0.1 * (high - low)
        assert low <= min(values) < low + tenth
        assert high - tenth < max(values) <= high
    assert {episode.latency for episode in episodes} == {0, 1, 2}
    assert {episode.reference for episode in episodes} == {0, 1}
    assert {len(setup.ground.patches) for setup in setups} == {0, 1, 2, 3}
    assert {setup.ground.along for setup in setups} == {0.70, 0.12}
    assert max(setup.ground.slope for setup in setups) > 0.08
    for setup, episode in zip(setups, episodes, strict=True):
        start, *_ = env.task.table.path(episode.reference)
        x, y, heading = np.array(setup.start) - start
        assert np.hypot(x, y) <= 0.2
        assert abs(wrap_angle(heading)) <= 0.3


UPHILL = Ground(slope=0.1745, uphill=np.pi / 2, shear=0.01)


@pytest.mark.parametrize(
    ("compensation", "ground", "pull"),
    [("icr_radius", Ground(), Pull()), ("online_load", UPHILL, Pull(20.0))],
)
def test_a_controller_keeps_the_path_as_it_does_elsewhere(
    robot, compensation, ground, pull, tmp_path
):
    """The classical controller of the closed loop, through the environment's eyes and hands."""
    laws = tmp_path / "laws.json"
    path = tmp_path / "arc.csv"
    under_load = IcrLoad(0.035, 0.168, 0.004, compliance=0.085, turn_compliance=0.2)
    save_laws(laws, load_laws() | {"icr_load": under_load}, robot.geometry)
    angles = np.linspace(0, 0.6, 7)
    points = [f"{0.8 * np.sin(a)},{0.8 - 0.8 * np.cos(a)}\n" for a in angles]
    path.write_text("x,y\n" + "".join(points))
    reference = load_reference(path)
    fleet = Fleet(robot, reference.pose([0.0]), ground, pull=pull)
    pilot = Pilot(LinearTimeVarying(), [0], named_compensation(compensation, robot.geometry, laws))
    (log,) = closed_loop(fleet, [pilot], reference)
    options = {"action": "twist", "compensation": compensation, "laws": str(laws), "pull": pull}
    drawn = Randomization(shear=(ground.shear, ground.shear))
    env = PathTrackingEnv(**options, reference=str(path), randomization=drawn)
    observation, info = env.reset(seed=0, options={"ground": ground})
    unit = np.array([element.scale for element in env.observed[:3]])
    poses = [info["true_pose"]]
    for _ in log.time[1:]:
        error = observation[:3] * unit  # the robot's frame: Eq. 18
        pose = reference.pose(info["time"])
        pose[2] -= error[2]
        pose[:2] -= se2.rotate(pose[2], error[:2])
        twist = LinearTimeVarying().twist(info["time"], pose, reference)
        observation, *_, info = env.step((twist / [0.3, 1.0]).astype(np.float32))
        poses.append(info["true_pose"])
    np.testing.assert_allclose(poses, log.truth.pose, atol=2e-4)  # but for settling and float32


def test_whatever_is_drawn_can_be_parked():
    drawn = Randomization(
        friction_ratio=(0.3, 3.0),
        com_x=(-0.03, 0.03),
        com_y=(-0.06, 0.06),
        slope=(0.0, 1.0),
        patches=(0, 10),
        shear=(0.0, 0.02),
        start_distance=(0.0, 0.4),
        start_heading=(-3.0, 3.0),
    )
    firm = tuple(name for name, ground in NAMED_GROUNDS.items() if ground.soil is None)
    env = PathTrackingVectorEnv(60, reference=tuple(REFERENCES), ground=firm, randomization=drawn)
    _, info = env.reset(seed=5)
    start = info["true_pose"]
    for _ in range(10):
        *_, info = env.step(np.zeros((60, 2), np.float32))
    assert np.abs(info["true_pose"] - start).max() < 2e-3  # ground that shears gives way a little


def test_observations_of_a_known_case():
    env = PathTrackingEnv(previews=2, preview_spacing=0.5, reference="circle")
    observation, info = env.reset(seed=0, options={"start_error": (-0.1, 0.2, 0.5)})
    # it starts at constant speed; the robot is behind, to the left and turned to the left
    cos = np.cos(0.5)
    sin = np.sin(0.5)
    error = np.array([cos * 0.1 - sin * 0.2, -sin * 0.1 - cos * 0.2])
    reference_twist = [0.15 / 0.3, 0.15 / 1.0]
    previews = [*reference_twist, *reference_twist, *reference_twist]
    expected = [*error / 0.5, -0.5 / np.pi, *previews, 0, 0, 0, 0]
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


def test_the_end_truncates_and_leaving_the_path_terminates(tmp_path):
    path = tmp_path / "line.csv"
    path.write_text("x,y\n0,0\n0.3,0\n0.7,0\n")
    env = PathTrackingEnv(reference=str(path), off_path=0.55, action="twist")
    reference = load_reference(path)
    _, info = env.reset(seed=0)
    steps = 0
    ended = False
    while not ended:
        twist = reference.twist(info["time"]) / [0.3, 1.0]
        _, _, terminated, ended, info = env.step(twist.astype(np.float32))
        steps += 1
        assert not terminated
    assert steps == np.ceil(reference.duration / 0.05)
    assert info["success"]
    env.reset(seed=0)
    while not terminated:
        before = info
        _, reward, terminated, truncated, info = env.step(np.zeros(2, np.float32))
        assert not truncated
    distance_before = np.hypot(*before["true_error"][:2])
    distance = np.hypot(*info["true_error"][:2])
    assert distance_before <= 0.55 < distance
    assert reward < -8
    assert info["reward_termination"] == -10
    assert not info["success"]


def test_rewards_are_the_sum_of_their_terms():
    weights = TrackingReward(weight_position=2.0, heading_scale=0.1)
    env = PathTrackingEnv(reward=weights, reference="slalom")
    env.reset(seed=0, options={"start_error": (0.1, 0.1, 0.2)})
    env.action_space.seed(0)
    previous = np.zeros(2)
    for _ in range(60):
        action = env.action_space.sample()
        _, reward, _, _, info = env.step(action)
        x, y, phi = info["true_error"]
        place = (x**2 + y**2) / 0.05**2
        turn = (phi / 0.1) ** 2
        change = np.mean((action.astype(float) - previous) ** 2) / 4
        assert info["reward_alive"] == 1
        assert info["reward_position"] == pytest.approx(-2 * place / (1 + place))
        assert info["reward_heading"] == pytest.approx(-0.2 * turn / (1 + turn))
        assert info["reward_change"] == pytest.approx(-0.1 * change)
        terms = [info[f"reward_{term}"] for term in TrackingReward.TERMS]
        assert reward == pytest.approx(sum(terms))
        previous = action.astype(float)


def test_an_action_arrives_after_the_latency():
    env = PathTrackingEnv()
    action = np.array([0.2, 0.2], np.float32)
    for latency in (0, 1, 2):
        env.reset(seed=0, options={"latency": latency})
        arrived = []
        for _ in range(4):
            *_, info = env.step(action)
            arrived.append(info["set_point"][0])
        expected = [0.0] * latency + [1.0] * (4 - latency)
        np.testing.assert_allclose(arrived, expected, atol=1e-6)


def test_options_ask_for_what_is_not_to_be_drawn():
    env = PathTrackingEnv(randomization="typical", robot=RobotParameters(half_gauge=0.2))
    assert env.task.fleet.robot.geometry.half_gauge == 0.2
    ground = Ground(0.4, 0.6)
    given = {"ground": ground, "start_error": (0, 0, 0), "com": (0.01, 0.0)}
    _, info = env.reset(seed=1, options=given)
    np.testing.assert_allclose(info["friction"], [0.4, 0.6])
    np.testing.assert_allclose(info["true_error"], 0, atol=1e-9)
    too_far = r"start_error = 0\.5.*: must be at most 0.5 m, which is off_path"
    for options, message in (
        ({"reference": "moon"}, "moon"),
        ({"latency": 3}, "latency"),
        ({"start_error": (0.3, -0.5, 0.0)}, too_far),
        ({"com": (1.0, 0.0)}, "com_x"),
        ({"ground": Ground(0.2, 0.2, slope=0.3)}, "slope"),
        ({"ground": "clay"}, r"ground\.shear = 0\.006: must be 0 in an environment"),
    ):
        with pytest.raises(InvalidValueError, match=message):
            env.reset(options=options)


def test_episodes_may_take_the_ground_of_the_robots_file(tmp_path):
    file = tmp_path / "robot.toml"
    file.write_text("mass = 31.0\n[ground]\nalong = 0.4\nacross = 0.5\n")
    config = EnvConfig(robot=str(file), ground=("robot", "ice"))
    assert config.parameters.mass == 31.0
    assert config.load_ground("robot") == Ground(0.4, 0.5)
    assert config.load_ground("ice") == NAMED_GROUNDS["ice"]


@pytest.mark.parametrize(
    ("ground", "drawn", "shears", "sinks", "is_soft"),
    [
        ("stone", None, False, False, False),
        ("clay", None, True, False, False),
        (("stone", "clay"), None, True, False, False),
        ("stone", Randomization(shear=(0.0, 0.01)), True, False, False),
        ("stone", Randomization(shear=(0.0, 0.0)), False, False, False),
        (("stone", "dry_sand"), None, True, True, False),
        (("lete_sand", "dry_sand"), None, True, True, True),
    ],
)
def test_what_grounds_need_is_known_before_any_is_drawn(ground, drawn, shears, sinks, is_soft):
    config = EnvConfig(ground=ground, randomization=drawn)
    assert (config.shears, config.sinks, config.is_soft) == (shears, sinks, is_soft)


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (
            {"compensation": "icr"},
            'compensation = \'icr\': must be "none" unless action is "twist"',
        ),
        ({"laws": "laws.json"}, "laws = 'laws.json': must be None unless compensation names a law"),
        (
            {"action": "twist", "compensation": "online_cold", "laws": "laws.json"},
            "laws = 'laws.json': must be None unless compensation names a law",
        ),
        ({"reference": ()}, r"reference = \(\): must be a name, or a tuple of names"),
        ({"preview_spacing": 0.02}, "preview_spacing = 0.02: must be a multiple of 0.05 s"),
        ({"preview_spacing": 0.12}, "preview_spacing = 0.12: must be a multiple of 0.05 s"),
        ({"twist_scale": (0.3,)}, r"twist_scale = \(0\.3,\): must be two numbers"),
        ({"scanner": LaserScanner(rate=10.0)}, "scanner.rate = 10.0: must be 20 Hz, once in a"),
        ({"randomization": "wild"}, "randomization = 'wild': must be a Randomization, \"typical\""),
        (
            {"ground": "dry_sand", "randomization": Randomization.typical()},
            "randomization = .*: must be without friction_ratio, patches and shear",
        ),
        (
            {"randomization": Randomization(start_distance=(0.0, 0.5))},
            r"start_distance = .*: must be less than off_path = 0\.5 m",
        ),
        ({"tolerance": -0.1}, "tolerance = -0.1: must be "),
    ],
)
def test_options_without_effect_or_sense_are_refused(options, said):
    with pytest.raises(InvalidValueError, match=said):
        EnvConfig(**options)


@pytest.mark.parametrize(
    "compensation", ["icr_radius", pytest.param("online", marks=pytest.mark.slow), "none"]
)
def test_out_of_sight_the_law_in_use_predicts_the_pose(compensation):
    """Feedforward out of the scanner's range: what is observed is dead reckoning."""
    env = PathTrackingEnv(
        reference="circle",
        action="twist",
        compensation=compensation,
        pose_source="scanner",
        scanner=LaserScanner(max_range=0.5),
        off_path=5.0,
    )
    env.reset(seed=0)
    reference = load_reference("circle")
    for k in range(500):
        twist = reference.twist(0.05 * k)
        *_, info = env.step((twist / [0.3, 1.0]).astype(np.float32))
    error = np.hypot(*(info["measured_pose"] - info["true_pose"])[:2])
    assert (error < 0.01) == (compensation != "none")


def test_states_include_what_was_driven_out_of_sight():
    options = {
        "reference": "circle",
        "action": "twist",
        "compensation": "online",
        "pose_source": "scanner",
        "scanner": LaserScanner(max_range=0.5),
    }
    env = PathTrackingEnv(**options)
    env.reset(seed=0)
    ahead = np.array([0.5, 0.1], np.float32)
    for _ in range(20):
        env.step(ahead)
    other = PathTrackingEnv(**options)
    other.reset(seed=1)
    other.unwrapped.set_state(env.unwrapped.get_state())
    for _ in range(20):
        expected, found = (each.step(ahead)[0] for each in (env, other))
        np.testing.assert_array_equal(found, expected)


def test_references_that_are_faster_than_the_robot_are_refused():
    slow = RobotParameters(drive=Drive(top_speed=0.19))
    fits = PathTrackingEnv(reference="paper", robot=slow)
    message = "reference = 'slalom': must be slow enough for the robot, at most 0.142 instead of"
    with pytest.raises(InvalidValueError, match=message):
        PathTrackingEnv(reference=("paper", "slalom"), robot=slow)
    with pytest.raises(InvalidValueError, match=message):
        fits.reset(seed=0, options={"reference": "slalom"})
    narrower = RobotParameters(drive=Drive(top_speed=0.205))
    PathTrackingEnv(reference="slalom", robot=narrower)
    with pytest.raises(InvalidValueError, match="reference = 'slalom'"):
        PathTrackingEnv(
            reference="slalom", robot=narrower, action="twist", compensation="icr_radius"
        )
