import numpy as np
import pytest

from experiments.speed.environments import BARE, ENV_CASES, SINGLE, VECTOR, EnvRig, env_speeds


def test_what_is_written(trackslip):
    result = trackslip(
        "bench", "--env", "--env-size", "2", "--thread-counts", "1", "--seconds", "0.4", "--repeats", "1"
    )
    rows = result.summary["rows"]
    assert [(row["case"], row["n"], row["threads"]) for row in rows] == [(case, 2, 1) for case in ENV_CASES]
    for row in rows:
        assert row["steps_per_s"] > 0
        assert row["case"] != BARE or row["ratio_to_bare"] == 1
        assert row["case"] != SINGLE or row["ratio_to_single"] == 1
    assert "SyncVectorEnv" in result.printed
    vector, bare = result.summary["traverse"]
    assert (vector["case"], bare["case"]) == ("Traverse-v0, vector env", "Traverse-v0, bare")
    assert (bare["ratio_to_bare"], vector["n"]) == (1, 2)
    assert vector["ratio_to_bare"] > 0
    assert "Traverse-v0" in result.printed


def test_the_bare_engine_does_what_the_environment_did():
    rig = EnvRig(3, threads=1, seed=0)
    rig.rates(20)
    state, fleet = rig._bare.qpos, rig._fleet
    np.testing.assert_allclose(state[:, :2], fleet.pose()[:, :2], atol=2e-3)
    assert np.linalg.norm(fleet.twist(), axis=1).min() > 0.05


def test_the_robots_keep_their_paths():
    rig = EnvRig(4, threads=1, seed=0)
    for case in (VECTOR, SINGLE):
        rig.drive(case, 60)
    for seen in rig._seen.values():
        assert np.abs(seen[:, :2]).max() < 0.1


def test_ratios_are_those_of_the_rounds():
    weather = np.array([1.0, 0.5, 0.2])
    rates = {(VECTOR, 5, 2): 80 * weather, (BARE, 5, 2): 100 * weather, (SINGLE, 5, 2): 10 * weather}
    speeds = {one.case: one for one in env_speeds(rates, 0.005)}
    assert speeds[VECTOR].ratio_to_bare == pytest.approx(0.8)
    assert speeds[VECTOR].ratio_to_single == pytest.approx(8.0)
    assert speeds[VECTOR].steps_per_s == pytest.approx(40)
    assert speeds[BARE].n == 5


def test_sizes_are_checked(refused):
    assert "env_size = 0: must be an integer" in refused("bench", "--env", "--env-size", "0")
