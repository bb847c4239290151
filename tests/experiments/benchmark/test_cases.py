import numpy as np
import pytest

from experiments.benchmark.cases import BenchmarkCase, planned_cases
from experiments.benchmark.config import Config
from experiments.benchmark.drive import ClosedLoops
from experiments.benchmark.page import answer
from experiments.benchmark.rows import board, over_seeds
from sim.ground.ground import load_ground
from sim.runs.stopwatch import StepTimes, Stopwatch


@pytest.mark.parametrize(("suite", "runs"), [("paper", 75), ("fair", 1344), ("full", 3024)])
def test_suites_have_every_run_once(suite, runs):
    cases = planned_cases(Config(suite=suite))
    assert len(set(cases)) == len(cases) == runs


def started(start, seed=0):
    return BenchmarkCase("linear", "none", "paper", "stone", start, seed).start_pose()


def test_starts_are_on_the_path_or_where_the_paper_starts():
    """Secs. IV-B and IV-C."""
    np.testing.assert_allclose(started("zero"), [0, 0, np.pi / 2], atol=1e-12)
    np.testing.assert_allclose(started("paper"), [0.3, -0.2, np.pi / 3], atol=1e-12)


def test_random_starts_are_spread_evenly_over_a_disc():
    """Of 15 cm, whose area within a distance d is (d / 15 cm)^2 of the whole; turned by up to 20
    degrees.
    """
    starts = np.array([started("random", seed) for seed in range(300)])
    place = starts[:, :2] / 0.15
    area = np.sum(place**2, axis=1)
    turn = (starts[:, 2] - np.pi / 2) / np.radians(20)
    # means within four standard errors: uniform on (0, 1), (-1, 1), and over a unit disc
    error = 4 / np.sqrt(len(starts))
    assert area.max() < 1
    assert area.mean() == pytest.approx(0.5, abs=error * np.sqrt(1 / 12))
    assert np.abs(turn).max() < 1
    assert np.mean(turn**2) == pytest.approx(1 / 3, abs=error * np.sqrt(4 / 45))
    assert np.mean(turn) == pytest.approx(0.0, abs=error * np.sqrt(1 / 3))
    np.testing.assert_allclose(place.mean(axis=0), 0.0, atol=error / 2)


@pytest.mark.slow
def test_a_run_is_the_same_in_any_company(tmp_path):
    """Whichever controllers, compensations and grounds share its fleet; all controllers meet the
    same noise.
    """
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
    linear = logs[cases[0].name]
    feedforward = logs[cases[4].name]
    np.testing.assert_array_equal(linear.pose[0], feedforward.pose[0])
    assert np.any(linear.pose[0] != linear.truth.pose[0])


def test_drawn_plants_are_the_same_for_all_controllers():
    loops = ClosedLoops(Config(), "drawn")
    cases = [
        BenchmarkCase("linear", "none", "circle", "stone", "zero", seed) for seed in range(200)
    ]
    plants = [loops.plant(case) for case in cases]
    of_another_controller = BenchmarkCase("lqr", "online", "circle", "stone", "random", 3)
    assert plants[3] == loops.plant(of_another_controller)
    of_another_path = BenchmarkCase("linear", "none", "slalom", "stone", "zero", 3)
    assert plants[3] != loops.plant(of_another_path)
    stone = load_ground("stone")
    ratios = [plant.setup.ground.across / stone.across for plant in plants]
    noises = [plant.scanner_noise / loops.config.scanner.noise for plant in plants]
    for values, low, high in ((ratios, 0.8, 1.25), (noises, 0.5, 2.0)):
        assert low <= min(values) < max(values) <= high
        assert np.mean(values) == pytest.approx((low + high) / 2, abs=0.1 * (high - low))
    assert abs(np.corrcoef(ratios, noises)[0, 1]) < 0.3


def test_plants_on_soft_soil_keep_its_friction():
    loops = ClosedLoops(Config(), "drawn")
    cases = [
        BenchmarkCase("linear", "none", "circle", "dry_sand", "zero", seed) for seed in range(20)
    ]
    plants = [loops.plant(case) for case in cases]
    assert {plant.setup.ground for plant in plants} == {load_ground("dry_sand")}
    assert len({plant.setup.radius_error for plant in plants}) == len(cases)


def run(controller, rms, success=True, error=None, seed=0, compensation="online"):
    axes = BenchmarkCase(controller, compensation, "paper", "stone", "zero", seed).axes
    if error:
        return axes | {"error": error}
    return axes | {
        "error": None,
        "rms_position": rms,
        "rms_position_after_12s": rms,
        "success": success,
    }


def test_means_are_over_the_seeds_that_ran():
    (row,) = over_seeds([run("a", 1.0), run("a", 3.0, seed=1), run("a", 0.0, error="no", seed=2)])
    assert row["rms_position"] == 2.0
    assert (row["seeds"], row["failed"]) == (3, 1)
    assert row["success"] == pytest.approx(2 / 3)
    assert row["final_position"] is None


def test_who_keeps_the_path_stands_above_who_is_near_it():
    runs = [
        run("near", 0.001, success=False),
        run("kept", 0.1),
        run("better", 0.05),
        run("failed", 0, error="no"),
    ]
    entries = board(runs)
    assert [entry["controller"] for entry in entries] == ["better", "kept", "near", "failed"]
    assert "2 of 4 entries lose the path in some runs" in answer(entries, "next", {}, 0.05).warnings


def test_controllers_slower_than_their_period_are_warned_of():
    entries = board([run("fast", 0.1), run("slow", 0.2)])
    steps = {"fast": StepTimes.of(100 * [0.001]), "slow": StepTimes.of(100 * [0.06])}
    warnings = answer(entries, "next", steps, 0.05).warnings
    assert steps["slow"].warning("slow", 0.05) in warnings
    assert sum("slow" in line for line in warnings) == 1
    assert not any("fast" in line for line in warnings)


def test_entries_are_compared_pair_by_pair():
    rng = np.random.default_rng(0)
    plant = rng.uniform(0.001, 0.1, 32)
    errors = {
        "first": plant,
        "second": plant + 0.001,
        "third": plant + 0.001 + 3e-5 * rng.normal(size=32),
    }
    runs = [
        run(name, rms, seed=k) for name, values in errors.items() for k, rms in enumerate(values)
    ]
    first, *others = board(runs)
    assert (first["controller"], first["rank"], first["behind"], first["behind_ci95"]) == (
        "first",
        1,
        0.0,
        None,
    )
    assert [entry["rank"] for entry in others] == [2, 2]
    for entry in others:
        low, high = entry["behind_ci95"]
        assert 0.0009 < low <= entry["behind"] <= high < 0.0011


@pytest.mark.slow
@pytest.mark.parametrize(("paths", "grounds", "seeds"), [(1, 1, 32), (4, 1, 8), (8, 3, 3)])
def test_intervals_of_differences_and_gains_cover_95_percent(paths, grounds, seeds):
    """Of a benchmark's suites; on the grounds of a seed the differences are nearly the same."""
    rng = np.random.default_rng(1)
    covered = []
    gains = []
    shape = (paths, grounds, seeds)
    for _ in range(400):
        plant = rng.exponential(0.01, shape)
        difference = 0.002 + rng.normal(0, 0.002, (paths, 1, seeds))
        scatter = rng.normal(0, 0.0002, shape)
        errors = {"online": plant, "none": plant + difference + scatter}
        runs = [
            run("linear", 0.1 + rms, seed=seed, compensation=name)
            | {"reference": f"{path}", "ground": f"{ground}"}
            for name, values in errors.items()
            for (path, ground, seed), rms in np.ndenumerate(values)
        ]
        entries = {entry["compensation"]: entry for entry in board(runs)}
        low, high = entries["none"]["behind_ci95"]
        covered.append(low < 0.002 < high)
        low, high = entries["online"]["gain_ci95"]
        gains.append(low < 0.112 / 0.11 < high)
        assert entries["none"]["gain"] is None
    assert 0.90 < np.mean(covered) < 0.99
    assert 0.90 < np.mean(gains) < 0.99


def test_a_single_plant_tells_no_interval():
    first, second = board([run("a", 0.001), run("b", 0.002)])
    assert first["rank"] == 1
    assert second["rank"] == 2
    assert second["behind_ci95"] is None
