"""States of both environments: what follows from them is the same to the bit."""

import pickle
from functools import partial

import gymnasium as gym
import numpy as np
import pytest
from results import assert_same

from sim.drive.drive import Drive
from sim.drive.pull import Pull
from sim.ground.ground import Change, Ground
from sim.scanner.scanner import LaserScanner
from sim.traverse.outcome import Limits
from trackslip.errors import InvalidValueError
from trackslip.laws.icr_load import IcrLoad

TRACKING, TRAVERSE = "sim:trackslip/PathTracking-v0", "sim:trackslip/Traverse-v0"
UNDER_LOAD = IcrLoad(0.035, 0.168, 0.004, compliance=0.085, turn_compliance=0.2)
CHANGING = Ground(0.7, 0.8, slope=0.1, changes=(Change(0.5, 0.5, 0.6),))
DRAWN = {"reference": ("paper", "slalom"), "ground": ("stone", "clay"), "randomization": "typical", "off_path": 0.22}
TWIST = DRAWN | {"action": "twist"}
COARSE = {"pose_source": "scanner", "scanner": LaserScanner(resolution=0.01, dropout=0.05)}
LEARNING = {"loads": True, "pull": Pull(10.0, since=1.0), "pose_source": "noisy"}
STATES = [
    (TRACKING, DRAWN | {"pose_source": "noisy"}, {"reference": "circle"}),
    (TRACKING, TWIST | {"compensation": UNDER_LOAD, "pose_source": "scanner"}, {"ground": CHANGING}),
    (TRACKING, DRAWN | {"drive": Drive(delay=0.127, droop=0.05)}, {}),
    (TRACKING, TWIST | COARSE | {"compensation": "online"}, {}),
    (TRACKING, TWIST | LEARNING | {"compensation": "online_cold"}, {"ground": CHANGING}),
    (TRAVERSE, {"course": ("random", "rough"), "limits": Limits(time=1.2, stuck_time=0.4), "period": 0.2}, {}),
    (TRAVERSE, {"course": "step10", "limits": Limits(stuck_time=0.8, stuck_share=2.0)}, {}),
]


def continued(env, steps):
    """Everything that an environment says now and in the next steps."""
    task, forward = env.unwrapped.task, np.array([0.9, 0.8, 0.0, 0.0, 0.0, 0.0])
    results = [(task.observation(), {name: values.copy() for name, values in task.info().items()})]
    for shake in np.random.default_rng(5).uniform(-0.1, 0.1, (steps, task.size, len(task.commanded))):
        actions = (forward[: len(task.commanded)] + shake).astype(np.float32)
        results.append(env.step(actions.reshape(env.action_space.shape)))
        if isinstance(env.unwrapped, gym.Env) and (results[-1][2] or results[-1][3]):
            results.append(env.reset())
    return results


@pytest.mark.parametrize("whose", ["its own", "another's"])
@pytest.mark.parametrize(("name", "options", "given"), STATES)
@pytest.mark.parametrize("make", [gym.make, partial(gym.make_vec, num_envs=3, threads=2, max_episode_steps=15)])
def test_an_environment_continues_from_a_state_to_the_bit(make, name, options, given, whose):
    def driven(seed, given, steps):
        env = make(name, **options)
        env.reset(seed=seed, options=given)
        continued(env, steps)
        return env

    env = driven(1, given, 7)
    state = env.unwrapped.get_state()
    expected = continued(env, 12)
    if whose == "another's":
        env, state = driven(2, {}, 10), pickle.loads(pickle.dumps(state))
    env.unwrapped.set_state(state)
    results = continued(env, 12)
    assert len(results) == len(expected)
    for one, two in zip(expected, results, strict=True):
        assert_same(one, two)


def test_states_of_other_environments_are_refused():
    state = gym.make_vec(TRACKING, num_envs=2).unwrapped.get_state()
    for wrong in (state, {}, None):
        with pytest.raises(InvalidValueError, match="state = 'that of"):
            gym.make(TRACKING).unwrapped.set_state(wrong)
