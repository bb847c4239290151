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
    quiet, noisy = (
        gym.make_vec(ID, num_envs=4, threads=1, course="flat", noise=noise)
        for noise in (SensorNoise(), deviations)
    )
    (exact, _), (first, _) = quiet.reset(seed=0), noisy.reset(seed=0)
    state, seen, errors = noisy.unwrapped.get_state(), [], []
    for _ in range(40):
        exact, first = (env.step(np.zeros((4, 6), np.float32))[0] for env in (quiet, noisy))
        seen.append(first)
        errors.append(first - exact)
    scale = np.array([element.scale for element in noisy.unwrapped.observed])
    spread = np.std(errors, axis=(0, 1)) * scale
    expected = np.repeat([*vars(deviations).values()], [3, 3, 1, 1, 2, 4, 45])
    np.testing.assert_allclose(
        np.delete(spread, [2, *range(14, 18)]), np.delete(expected, 2), rtol=0.25
    )
    np.testing.assert_array_equal(np.array(errors)[..., 14:18], 0)  # set points
    noisy.unwrapped.set_state(state)
    again = [noisy.step(np.zeros((4, 6), np.float32))[0] for _ in range(5)]
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
    gain, work, took = np.array([[0.1, 0.2, 0.0, -0.1], [0.1, 0.0, 0.0, 0.0], [0.1] * 4])
    reward = CrossingReward()
    terms = dict(zip(reward.TERMS, reward.terms(gain, work, took, change, outcome), strict=True))
    np.testing.assert_allclose(terms["progress"], [0.2, 0.4, 0.0, -0.2])
    np.testing.assert_allclose(terms["energy"], [-0.03, 0, 0, 0])
    np.testing.assert_allclose(terms["time"], -0.05)
    np.testing.assert_allclose(terms["change"], [-0.005, 0, -0.01, 0])
    np.testing.assert_allclose(terms["end"], [0, 5, -1, 0])  # running out of time truncates
    env = gym.make(ID).unwrapped
    env.reset(seed=0)
    _, reward, _, _, info = env.step(np.ones(6, np.float32))
    assert reward == pytest.approx(
        sum(info[name] for name in info if name.startswith("reward_")), abs=1e-12
    )
    assert info["reward_energy"] == pytest.approx(-0.3 * info["work"] / (31.0 * 9.81), rel=0.01)


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore:after 40 attempts")  # random flippers wedge a robot
def test_a_failed_try_earns_between_standing_and_crossing():
    rng, limits, returns, outcomes = (
        np.random.default_rng(0),
        Limits(time=20.0, stuck_time=3.0),
        [],
        [],
    )

    def forwards(shape):
        return rng.uniform(-1, 1, shape) * ([0.4] * 2 + [1.0] * 4) + ([0.6] * 2 + [0.0] * 4)

    for action, difficulty, act in (
        ("direct", 1.0, np.zeros),
        ("direct", 1.0, forwards),
        ("correction", 0.0, np.zeros),
    ):
        config = TraverseConfig(course=KINDS, action=action, limits=limits, period=0.2)
        task, total, discount = (
            Crossing(config, 3 * len(KINDS), threads=1),
            np.zeros(3 * len(KINDS)),
            1.0,
        )
        options = [{"course": kind, "difficulty": difficulty} for kind in KINDS for _ in range(3)]
        task.begin(
            range(task.size),
            [task.draw(np.random.default_rng(k), own) for k, own in enumerate(options)],
        )
        while (task.outcome == Outcome.DRIVING).any():
            task.step(act((task.size, len(task.commanded))))
            total += discount * task.reward
            discount *= 0.97
        returns.append(total.reshape(-1, 3))
        outcomes.append(task.outcome.reshape(-1, 3))
    (still, tried, driven), crossed = returns, outcomes[2] == Outcome.REACHED
    failed = (outcomes[1] != Outcome.REACHED) & (outcomes[1] != Outcome.TIME)
    assert failed.any(axis=1).sum() >= 7
    assert crossed.any(axis=1).all()
    assert (still.max() < tried[failed]).all()
    best = np.where(failed, tried, -np.inf).max(axis=1)
    assert (np.where(crossed, driven, np.inf).min(axis=1) > best).all()
