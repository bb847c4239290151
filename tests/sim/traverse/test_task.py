import gymnasium as gym
import numpy as np
import pytest

from sim import Limits, Outcome, SensorNoise, TraverseConfig
from sim.terrain import Course, Rough
from sim.traverse.config import CrossingReward
from sim.traverse.courses import KINDS
from sim.traverse.task import Crossing
from trackslip.errors import InvalidValueError

ID = "sim:trackslip/Traverse-v0"


def test_the_observation_is_what_it_says():
    env = gym.make(ID, course="step10").unwrapped
    observation, _ = env.reset(seed=0, options={"start_offset": 0.3, "start_heading": 0.1})
    np.testing.assert_allclose(observation[:3], [0, 0, 1], atol=1e-6)
    np.testing.assert_allclose(observation[6:8], [0.3, 0.1 / np.pi], atol=1e-6)
    # level all around, two millimetres below the tracks
    np.testing.assert_allclose(observation[18:], 0.0, atol=0.01)
    world = env.task.world
    # the step of 0.1 m is at x = 0, seen from where columns are 0.1 m apart
    world.state.qpos[0, 0] = -0.55
    world.state.qpos[0, 3:7] = 1, 0, 0, 0
    heights = env.task.observation()[0, 18:].reshape(3, 15) * 0.3
    np.testing.assert_allclose(heights[:, :11], 0.0, atol=0.003)
    np.testing.assert_allclose(heights[:, 11:], 0.1, atol=0.003)


def test_noise_is_as_large_as_asked_and_reproducible():
    deviations = SensorNoise(0.01, 0.2, 0.05, 0.03, 0.02, 0.01, 0.1)
    still = np.zeros((4, 6), np.float32)
    quiet = gym.make_vec(ID, num_envs=4, threads=1, course="flat", noise=SensorNoise())
    noisy = gym.make_vec(ID, num_envs=4, threads=1, course="flat", noise=deviations)
    quiet.reset(seed=0)
    noisy.reset(seed=0)
    state = noisy.unwrapped.get_state()
    seen = []
    errors = []
    for _ in range(40):
        exact, *_ = quiet.step(still)
        observation, *_ = noisy.step(still)
        seen.append(observation)
        errors.append(observation - exact)
    scale = np.array([element.scale for element in noisy.unwrapped.observed])
    spread = np.std(errors, axis=(0, 1)) * scale
    set_points = [*range(14, 18)]
    up = 2  # the direction's vertical part, which doesn't change to first order
    expected = np.repeat([*vars(deviations).values()], [3, 3, 1, 1, 2, 4, 45])
    spread = np.delete(spread, [up, *set_points])
    np.testing.assert_allclose(spread, np.delete(expected, up), rtol=0.25)
    np.testing.assert_array_equal(np.array(errors)[..., set_points], 0)  # of the flippers
    noisy.unwrapped.set_state(state)
    again = [noisy.step(still)[0] for _ in range(5)]
    np.testing.assert_array_equal(again, seen[:5])


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"course": Course((Rough(),))}, "height fields"),
        ({"speed": 1.0}, "options = 'speed'"),
        (
            {"course": "step10", "start_offset": -5.0},
            r"start_offset = -5\.0: must be from -1\.5 to 1\.5 m",
        ),
        ({"course": "waves"}, "'waves': must be a course, or one of step10, random"),
    ],
)
def test_options_that_make_no_sense_are_refused(options, message):
    env = gym.make(ID, course=("random", "step10"))
    with pytest.raises(InvalidValueError, match=message):
        env.reset(options=options)


@pytest.mark.parametrize(
    "given",
    [
        {"course": "step10"},
        {"course": "random"},
        {"course": "rails"},
        {"course": Course((Rough(),))},
        {"difficulty": 0.9},
        {"start_offset": 0.2},
        {"start_heading": -0.1},
    ],
    ids=str,
)
def test_given_values_leave_the_drawn_mass_alone(given):
    courses = ("random", "rails", "step10")
    task = Crossing(TraverseConfig(course=courses, mass=(0.5, 2.0)), 1, threads=1)
    for seed in range(6):
        drawn = task.draw(np.random.default_rng(seed), {})
        replaced = task.draw(np.random.default_rng(seed), given)
        assert replaced.mass == drawn.mass
        assert replaced.seed == drawn.seed


def test_the_reward_is_the_sum_of_its_terms():
    outcome = np.array([Outcome.DRIVING, Outcome.REACHED, Outcome.TIPPED, Outcome.TIME])
    change = np.array([[1.0, -1.0], [0.0, 0.0], [0.0, 2.0], [0.0, 0.0]])
    gain = np.array([0.1, 0.2, 0.0, -0.1])
    work = np.array([0.1, 0.0, 0.0, 0.0])
    took = np.array([0.1, 0.1, 0.1, 0.1])
    reward = CrossingReward()
    values = reward.terms(gain, work, took, change, outcome)
    terms = dict(zip(reward.TERMS, values, strict=True))
    np.testing.assert_allclose(terms["progress"], [0.2, 0.4, 0.0, -0.2])
    np.testing.assert_allclose(terms["energy"], [-0.03, 0, 0, 0])
    np.testing.assert_allclose(terms["time"], -0.05)
    np.testing.assert_allclose(terms["change"], [-0.005, 0, -0.01, 0])
    np.testing.assert_allclose(terms["end"], [0, 5, -1, 0])  # running out of time truncates
    env = gym.make(ID).unwrapped
    env.reset(seed=0)
    _, reward, _, _, info = env.step(np.ones(6, np.float32))
    terms = [value for name, value in info.items() if name.startswith("reward_")]
    assert reward == pytest.approx(sum(terms), abs=1e-12)
    weight = 31.0 * 9.81
    assert info["reward_energy"] == pytest.approx(-0.3 * info["work"] / weight, rel=0.01)


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore:after 40 attempts")  # random flippers wedge a robot
def test_a_failed_try_earns_between_standing_and_crossing():
    rng = np.random.default_rng(0)
    limits = Limits(time=20.0, stuck_time=3.0)
    returns = []
    outcomes = []

    def forwards(shape):
        """Random actions: belts from 0.2 to 1, flippers from -1 to 1."""
        half_range = [0.4, 0.4, 1.0, 1.0, 1.0, 1.0]
        middle = [0.6, 0.6, 0.0, 0.0, 0.0, 0.0]
        return rng.uniform(-1, 1, shape) * half_range + middle

    for action, difficulty, act in (
        ("direct", 1.0, np.zeros),
        ("direct", 1.0, forwards),
        ("correction", 0.0, np.zeros),
    ):
        config = TraverseConfig(course=KINDS, action=action, limits=limits, period=0.2)
        task = Crossing(config, 3 * len(KINDS), threads=1)
        total = np.zeros(3 * len(KINDS))
        discount = 1.0
        options = [{"course": kind, "difficulty": difficulty} for kind in KINDS for _ in range(3)]
        draws = [task.draw(np.random.default_rng(k), own) for k, own in enumerate(options)]
        task.begin(range(task.size), draws)
        while (task.outcome == Outcome.DRIVING).any():
            task.step(act((task.size, len(task.commanded))))
            total += discount * task.reward
            discount *= 0.97
        returns.append(total.reshape(-1, 3))
        outcomes.append(task.outcome.reshape(-1, 3))
    still, tried, driven = returns
    _, outcome_tried, outcome_driven = outcomes
    crossed = outcome_driven == Outcome.REACHED
    failed = (outcome_tried != Outcome.REACHED) & (outcome_tried != Outcome.TIME)
    assert failed.any(axis=1).sum() >= 7
    assert crossed.any(axis=1).all()
    assert (still.max() < tried[failed]).all()
    best_failure = np.where(failed, tried, -np.inf).max(axis=1)
    worst_crossing = np.where(crossed, driven, np.inf).min(axis=1)
    assert (worst_crossing > best_failure).all()
