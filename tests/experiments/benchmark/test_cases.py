"""The runs of benchmarks: suites, starts, plants, and independence of their company."""

import numpy as np
import pytest

from experiments.benchmark.cases import BenchmarkCase, planned_cases
from experiments.benchmark.config import Config
from experiments.benchmark.drive import ClosedLoops
from sim.ground.ground import load_ground
from sim.stopwatch import Stopwatch


@pytest.mark.parametrize(("suite", "runs"), [("paper", 75), ("fair", 1344), ("full", 3024)])
def test_suites_have_every_run_once(suite, runs):
    cases = planned_cases(Config(suite=suite))
    assert len(set(cases)) == len(cases) == runs


@pytest.mark.slow
def test_a_run_is_the_same_in_any_company(tmp_path):
    """Whichever controllers, compensations and grounds share its fleet; all controllers meet the same noise."""
    path = tmp_path / "bow.csv"
    path.write_text("x,y\n-2,1\n-1.6,1.1\n-1.2,1.4\n")
    loops = ClosedLoops(Config())
    cases = [
        BenchmarkCase(controller, compensation, str(path), ground, "random", seed)
        for controller in ("linear", "feedforward")
        for compensation in ("online", "icr_radius")
        for ground, seed in (("stone", 0), ("ice", 1))
    ]
    logs = {log.run: log for log in loops.drive(cases, Stopwatch(), None)}
    for case in (cases[0], cases[5]):
        (alone,) = loops.drive([case], Stopwatch(), None)
        np.testing.assert_array_equal(alone.truth.pose, logs[case.name].truth.pose)
        np.testing.assert_array_equal(alone.pose, logs[case.name].pose)
    linear, feedforward = (logs[case.name].pose[0] for case in (cases[0], cases[4]))
    np.testing.assert_array_equal(linear, feedforward)
    assert np.any(linear != logs[cases[0].name].truth.pose[0])


def test_starts_are_the_papers_or_random_and_the_same_for_all_controllers():
    case = BenchmarkCase("linear", "none", "paper", "stone", "paper", 0)
    np.testing.assert_allclose(case.start_pose(), [0.3, -0.2, np.pi / 3], atol=1e-12)
    runs = ("lqr", 0), ("samson", 0), ("lqr", 1)
    first, same, other = (BenchmarkCase(c, "none", "paper", "stone", "random", n).start_pose() for c, n in runs)
    np.testing.assert_array_equal(first, same)
    assert np.hypot(*(first - other)[:2]) > 0.01


def test_plants_are_drawn_around_the_nominal_one_and_are_the_same_for_all_controllers():
    loops = ClosedLoops(Config(), "drawn")
    plants = [loops.plant(BenchmarkCase("linear", "none", "circle", "stone", "zero", seed)) for seed in range(200)]
    assert plants[3] == loops.plant(BenchmarkCase("lqr", "online", "circle", "stone", "random", 3))
    assert plants[3] != loops.plant(BenchmarkCase("linear", "none", "slalom", "stone", "zero", 3))
    ratios = [plant.setting.ground.across / load_ground("stone").across for plant in plants]
    noises = [plant.scanner_noise / loops.config.scanner.noise for plant in plants]
    for values, low, high in ((ratios, 0.8, 1.25), (noises, 0.5, 2.0)):
        assert low <= min(values) < max(values) <= high
        assert np.mean(values) == pytest.approx((low + high) / 2, abs=0.1 * (high - low))
    assert abs(np.corrcoef(ratios, noises)[0, 1]) < 0.3
