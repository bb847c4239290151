"""The runs of benchmarks: suites, starts, plants, and independence of their company."""

import numpy as np
import pytest

from experiments.benchmark.cases import BenchmarkCase, planned_cases
from experiments.benchmark.config import Config
from experiments.benchmark.drive import ClosedLoops
from experiments.common.choices import CONTROLLER_NAMES, GROUND_NAMES, REFERENCE_NAMES
from experiments.common.sweep import fleets
from sim.ground.named import NAMED_GROUNDS, load_ground
from sim.stopwatch import Stopwatch
from trackslip.controllers.named import CONTROLLERS
from trackslip.trajectory.named import REFERENCES


def test_suites_know_all_names():
    assert tuple(CONTROLLERS) == CONTROLLER_NAMES
    assert tuple(REFERENCES) == REFERENCE_NAMES
    assert tuple(NAMED_GROUNDS) == GROUND_NAMES


@pytest.mark.parametrize(("suite", "runs"), [("paper", 75), ("fair", 1344), ("full", 3024)])
def test_fleets_are_of_one_reference_and_no_larger_than_worthwhile(suite, runs):
    cases = planned_cases(Config(suite=suite))
    groups = fleets(cases, 2, ClosedLoops.sizes)
    assert len({case for group in groups for case in group}) == sum(map(len, groups)) == len(cases) == runs
    for group in groups:
        assert len({case.reference for case in group}) == 1
        assert len(group) <= 32


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
    starts = [
        BenchmarkCase(c, "none", "paper", "stone", "random", n).start_pose() for c in ("linear", "lqr") for n in (0, 1)
    ]
    np.testing.assert_array_equal(starts[:2], starts[2:])
    assert np.hypot(*(starts[0] - starts[1])[:2]) > 0.01


def test_ids_depend_on_the_contents_of_a_users_modules(tmp_path, short):
    (tmp_path / "gains_of_mine.py").write_text("K = 1.0")
    source = "import gains_of_mine\nfrom trackslip.controllers.error_feedback import LinearTimeVarying as Mine"
    (tmp_path / "imports_gains.py").write_text(source)
    loops = ClosedLoops(Config(localization="truth"))
    cases = [BenchmarkCase("imports_gains:Mine", "none", "bend.csv", "stone", "zero", 0)]
    loops.check(cases)
    before = loops.identified(cases)
    assert loops.identified(cases) == before
    (tmp_path / "gains_of_mine.py").write_text("K = 2.0")
    assert loops.identified(cases) != before


def test_plants_are_drawn_around_the_nominal_one_and_are_the_same_for_all_controllers():
    loops = ClosedLoops(Config(), "drawn")
    plants = [loops.plant(BenchmarkCase("linear", "none", "circle", "stone", "zero", seed)) for seed in range(200)]
    assert plants[3] == loops.plant(BenchmarkCase("lqr", "online", "circle", "stone", "random", 3))
    assert plants[3] != loops.plant(BenchmarkCase("linear", "none", "slalom", "stone", "zero", 3))
    drawn = np.array(
        [
            [
                plant.setting.ground.across / load_ground("stone").across,
                plant.setting.radius_error - loops.world.radius_error,
                plant.setting.lag / loops.world.drive.lag,
                *plant.setting.weight,
                plant.scanner_noise / loops.config.scanner.noise,
                len(plant.setting.ground.patches),
            ]
            for plant in plants
        ]
    )
    low, high = np.array([[0.8, -0.03, 0.5, -0.0168, -0.0168, 0.5, 0], [1.25, 0.03, 2.0, 0.0168, 0.0168, 2.0, 2]])
    assert np.all((drawn >= low) & (drawn <= high))
    np.testing.assert_allclose(drawn.mean(axis=0), (low + high) / 2, atol=0.1 * (high - low).max())
    assert np.abs(np.corrcoef(drawn.T) - np.eye(len(low))).max() < 0.3


def test_a_plant_drives_as_its_radius_error_says(tmp_path):
    """On the straight start of a path, without feedback: v of the drawn radius."""
    path = tmp_path / "straight.csv"
    path.write_text("x,y\n0,0\n0.5,0\n1,0\n")
    loops = ClosedLoops(Config(localization="truth"), "drawn")
    cases = [BenchmarkCase("feedforward", "none", str(path), "stone", "zero", seed) for seed in range(3)]
    for case, log in zip(cases, loops.drive(cases, Stopwatch(), None), strict=True):
        error = loops.plant(case).setting.radius_error
        assert log.metadata["radius_error"] == error
        driven = np.hypot(*(log.truth.pose[-1] - log.truth.pose[0])[:2])
        assert driven == pytest.approx(1 + error, abs=0.006)
