from functools import partial

import gymnasium as gym
import numpy as np
import pytest
from results import assert_same

from sim import Drive, LaserScanner, Limits, Pull, Randomization, RobotParameters
from sim.common.array_file import read_nested, write_nested
from sim.ground.ground import Change, Ground
from trackslip.laws.icr import IcrLoad

TRACKING = "sim:trackslip/PathTracking-v0"
TRAVERSE = "sim:trackslip/Traverse-v0"
UNDER_LOAD = IcrLoad(0.035, 0.168, 0.004, compliance=0.085, turn_compliance=0.2)
CHANGING = Ground(0.7, 0.8, slope=0.1, changes=(Change(0.5, 0.5, 0.6),))
DRAWN = {
    "reference": ("paper", "slalom"),
    "ground": ("stone", "clay"),
    "randomization": "typical",
    "off_path": 0.22,
}
TWIST = DRAWN | {"action": "twist"}
COARSE = {"pose_source": "scanner", "scanner": LaserScanner(resolution=0.01, dropout=0.05)}
LEARNING = {
    "loads": True,
    "pull": Pull(10.0, since=0.1),
    "pose_source": "noisy",
    "compensation": "online_cold",
}
ALONE = gym.make
BATCH = partial(gym.make_vec, num_envs=2, threads=2, max_episode_steps=8)
WEAK = Drive(lag=0.127, torque_limit=3.0)
STATES = [
    (BATCH, TRACKING, DRAWN | {"robot": RobotParameters(drive=WEAK)}, {"reference": "circle"}),
    (ALONE, TRACKING, TWIST | COARSE | {"compensation": UNDER_LOAD}, {"ground": CHANGING}),
    (BATCH, TRACKING, TWIST | LEARNING | {"compensation": "online"}, {}),
    (
        BATCH,
        TRACKING,
        TWIST | LEARNING | {"randomization": Randomization(mass=(0.5, 2.0))},
        {"ground": CHANGING},
    ),
    (
        BATCH,
        TRAVERSE,
        {"course": ("random", "rough"), "limits": Limits(time=1.0, stuck_time=0.4), "period": 0.2},
        {},
    ),
]


def continued(env, steps):
    """What an environment tells now and in the next steps, of which each robot shakes its own."""
    task = env.unwrapped.task
    count = len(task.commanded)
    forward = np.array([0.9, 0.8, 0.0, 0.0, 0.0, 0.0])[:count]
    info = {name: values.copy() for name, values in task.info().items()}
    results = [(task.observation(), info)]
    shakes = np.random.default_rng(5).uniform(-0.1, 0.1, (steps, task.size, count))
    for shake in shakes:
        actions = (forward + shake).astype(np.float32)
        result = env.step(actions.reshape(env.action_space.shape))
        results.append(result)
        _, _, terminated, truncated, _ = result
        if isinstance(env.unwrapped, gym.Env) and (terminated or truncated):
            results.append(env.reset())
    return results


@pytest.mark.parametrize(("make", "name", "options", "given"), STATES)
def test_an_environment_continues_from_its_state_and_from_a_file(
    make, name, options, given, tmp_path
):
    """To the bit; the file has neither pickle nor names of code."""
    env = make(name, **options)
    other = make(name, **options)
    env.reset(seed=1, options=given)
    continued(env, 4)
    state = env.unwrapped.get_state()
    expected = continued(env, 6)
    other.reset(seed=2)
    continued(other, 2)
    write_nested(tmp_path / "state.npz", state)
    read = read_nested(tmp_path / "state.npz", "a state")
    for each, stored in ((env, state), (other, read)):
        each.unwrapped.set_state(stored)
        for before, after in zip(expected, continued(each, 6), strict=True):
            assert_same(before, after)
