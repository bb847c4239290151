import numpy as np

from experiments.speed.simulator import BARE
from experiments.speed.traverse import VECTOR, TraverseRig


def test_the_bare_engine_does_what_the_environment_did():
    rig = TraverseRig(3, threads=1, seed=2)
    begun = rig._batch.qpos[:, 0].copy()
    rates = rig.rates(4)
    assert set(rates) == {VECTOR, BARE}
    np.testing.assert_allclose(rig._bare.qpos[:, :3], rig._batch.qpos[:, :3], atol=3e-3)
    assert (rig._batch.qpos[:, 0] - begun).min() > 0.1


def test_courses_are_measured_with_the_environments(trackslip):
    options = ("--env-size", "2", "--thread-counts", "1", "--seconds", "0.4", "--repeats", "1")
    result = trackslip("bench", "--env", *options)
    vector, bare = result.summary["traverse"]
    assert (vector["case"], bare["case"]) == ("Traverse-v0, vector env", "Traverse-v0, bare")
    assert bare["ratio_to_bare"] == 1
    assert vector["ratio_to_bare"] > 0
    assert "Traverse-v0" in result.printed
