import json
import subprocess
import sys

import numpy as np
import pytest

from experiments.options.bench import BenchConfig
from experiments.speed import simulator
from experiments.speed.simulator import CASES, Rig, case_speeds, measure_simulator, thread_speedups

SMALL = ("--sizes", "1", "2", "--thread-counts", "1", "--seconds", "0.2", "--repeats", "2")
TIMESTEP = 0.005


def test_what_is_written(trackslip):
    result = trackslip("bench", *SMALL, "--seed", "4")
    assert {path.name for path in result.folder.iterdir()} == {"manifest.json", "summary.json"}
    rows = result.summary["rows"]
    assert [(row["case"], row["n"], row["threads"]) for row in rows] == [(c, n, 1) for n in (1, 2) for c in CASES]
    for row in rows:
        assert set(row) == {"case", "n", "threads", "steps_per_s", "ratio_to_bare", "real_time_factor"}
        assert row["steps_per_s"] > 0
        assert row["ratio_to_bare"] > 0
        assert row["real_time_factor"] == pytest.approx(row["steps_per_s"] * TIMESTEP, rel=1e-12)
        assert row["case"] != "bare" or row["ratio_to_bare"] == 1
    assert result.summary["thread_speedup"] == []
    assert result.summary["peak_memory_mb"] is None or 10 < result.summary["peak_memory_mb"] < 100_000
    assert result.summary["timing"]["wall_s"] > 0
    assert result.manifest["seed"] == 4
    assert result.manifest["config"]["sizes"] == [1, 2]
    assert len(result.manifest["model_sha256"]) == 64
    assert "closed loop" in result.printed
    assert "Speed-up over one thread" not in result.printed


def test_two_thread_counts_are_compared(trackslip):
    result = trackslip("bench", "--sizes", "1", "--thread-counts", "2", "1", "--seconds", "0.1", "--repeats", "1")
    speedup = result.summary["thread_speedup"]
    assert [(row["case"], row["n"], row["threads"]) for row in speedup] == [(case, 1, 2) for case in CASES]
    assert [row["threads"] for row in result.summary["rows"]] == [1] * 4 + [2] * 4
    assert "Speed-up over one thread" in result.printed


@pytest.mark.parametrize("size", [1, 3])
def test_the_bare_batch_moves_as_the_fleet_does(robot, size):
    """To the bit, so both do the same work, though the one steps in one call and the other in servo periods."""
    rig = Rig(robot, size, threads=1, seed=0)
    before = rig.fleet.pose()
    rig.cases["bare"](7)
    assert (rig.fleet.pose() == before).all()
    rig.cases["fleet"](3)
    rig.cases["scanner"](4)
    np.testing.assert_array_equal(rig.bare.state, rig.fleet.batch.state)
    assert np.linalg.norm((rig.fleet.pose() - before)[:, :2], axis=1) == pytest.approx(0.15 * 0.35, rel=0.02)


@pytest.mark.parametrize("case", CASES)
def test_as_many_steps_pass_as_are_counted(robot, monkeypatch, case):
    rig = Rig(robot, 2, threads=1, seed=0)
    batch = rig.bare if case == "bare" else rig.fleet.batch
    before = batch.time.copy()
    clock = []

    def tick():
        clock.append((batch.time - before).sum() / TIMESTEP)  # steps so far
        return 0.25 * len(clock)

    monkeypatch.setattr(simulator, "perf_counter", tick)
    rate = rig.rate(case, 21)
    assert rate * 0.25 * (len(clock) - 1) == pytest.approx(clock[-1] - clock[0], abs=1e-6)
    assert clock[-1] - clock[0] == pytest.approx(2 * 21 * 10, abs=1e-6)


def test_all_but_the_closed_loop_simulate_the_same_time(robot):
    rig = Rig(robot, 2, threads=1, seed=0)
    assert [rig.periods(case, 12.0) for case in CASES] == [120, 120, 120, 12]
    assert [rig.periods(case, 0.01) for case in CASES] == [2, 2, 2, 6]


def test_the_robots_stay_on_their_circle(robot):
    """So that what a case is measured on doesn't depend on how long the benchmark has been running."""
    rig = Rig(robot, 2, threads=1, seed=0)
    twists = []
    for _ in range(3):
        rig.cases["closed loop"](20)
        twists.append(rig.fleet.twist()[:, [0, 2]])
        rig.cases["scanner"](20)
        twists.append(rig.fleet.twist()[:, [0, 2]])
    np.testing.assert_allclose(twists, np.broadcast_to([0.15, 0.12], (6, 2, 2)), atol=0.006)


def test_a_machine_that_slows_down_steadily_favours_no_case(robot, monkeypatch):
    """Two rounds, one forwards and one backwards, have the same mean for every case; the warm-up does not count."""
    clock, rounds = [], []

    class FakeRig:
        def __init__(self, _robot, _size, _threads, _seed):
            pass

        def periods(self, _case, _seconds):
            return 2

        def rate(self, _case, _periods):
            clock.append(1)
            return 1e6 if not rounds else 1000.0 - len(clock)

    monkeypatch.setattr(simulator, "Rig", FakeRig)
    rates = measure_simulator(BenchConfig(sizes=(3,), thread_counts=(1, 2), repeats=2), robot, rounds.append)
    assert len(rounds) == 3
    assert {rate.shape[0] for rate in rates.values()} == {2}
    assert len({rate.mean() for rate in rates.values()}) == 1


def test_rates_are_compared_within_a_turn():
    """A machine that is slower at times changes no ratio."""
    weather = np.array([[1.0, 0.25], [0.5, 0.4], [0.3, 0.3]])  # 3 rounds of 2 turns
    rates = {
        (case, 2, threads): threads * 100.0 / (1 + k) * weather for k, case in enumerate(CASES) for threads in (1, 3)
    }
    rates["fleet", 2, 1] = rates["fleet", 2, 1] * [[1.0, 1.0], [1.0, 0.01], [1.0, 1.0]]  # one measurement is disturbed
    rates["closed loop", 2, 1], rates["closed loop", 2, 3] = np.full((3, 1), 25 * 0.4), np.full((3, 1), 75 * 0.4)
    speeds = {(one.case, one.threads): one for one in case_speeds(rates, 0.01)}
    quick = CASES[:3]
    assert [speeds[case, 3].ratio_to_bare for case in quick] == pytest.approx([1, 1 / 2, 1 / 3])
    assert speeds["fleet", 1].ratio_to_bare == pytest.approx(1 / 2)
    # a measurement of the closed loop is compared with all turns of its round
    assert speeds["closed loop", 3].ratio_to_bare == pytest.approx(np.median(0.1 / weather))
    assert speeds["bare", 3].steps_per_s == pytest.approx(300 * 0.35)
    assert speeds["bare", 3].real_time_factor == pytest.approx(3 * 0.35)
    assert [one.speedup for one in thread_speedups(rates)] == pytest.approx([3, 3, 3, 3])
    assert thread_speedups({key: rate for key, rate in rates.items() if key[2] > 1}) == []


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("--sizes",), "sizes = (): must be at least one number"),
        (("--sizes", "0"), "sizes = 0: must be an integer from 1 to 10000"),
        (("--sizes", "1", "20000"), "sizes = 20000: must be an integer from 1 to 10000"),
        (("--sizes", "2", "2"), "sizes = (2, 2): must be all different"),
        (("--sizes", "1.5"), "1.5"),
        (("--thread-counts", "0"), "thread_counts = 0: must be an integer from 1 to 1024"),
        (("--thread-counts", "1", "1"), "thread_counts = (1, 1): must be all different"),
        (("--seconds", "0"), "seconds = 0.0: must be a finite number > 0"),
        (("--seconds", "nan"), "seconds = nan"),
        (("--seconds", "1e6"), "seconds = 1000000.0: must be at most 3600 s"),
        (("--repeats", "0"), "repeats = 0: must be an integer from 1 to 1000"),
        (("--seed", "-1"), "seed = -1: must be an integer >= 0"),
    ],
)
def test_mistakes_get_one_line(refused, arguments, message):
    assert message in refused("bench", *arguments)


def test_help_starts_no_simulator():
    code = (
        "import sys, contextlib\nfrom experiments.cli import main\n"
        "with contextlib.suppress(SystemExit): main(['bench', '--help'])\n"
        "print([m for m in ('mujoco', 'scipy', 'matplotlib', 'rerun') if m in sys.modules])"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert json.loads(done.stdout.splitlines()[-1]) == []
    assert "--thread-counts" in done.stdout
