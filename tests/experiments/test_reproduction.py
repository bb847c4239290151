"""The paper's runs, shared out: the same bits by any number of workers, and what is left when some fail."""

import gc
import io
import json
import pickle
import weakref
from dataclasses import replace

import numpy as np
import pytest

from experiments.commands.reproduce import Config
from experiments.driving.grid_runs import cells_of
from experiments.driving.paper_model import KNOWN_LAWS
from experiments.measuring.grid import LocalizationErrors, _PosesOverBound, grid_summary
from experiments.parallel import workers
from experiments.reproduction import CONTROLLERS, Share, closed_loop_shares, grid_shares, joined
from sim.robot.robot import load_robot
from sim.run_recorder import FAILURE
from sim.stopwatch import Stopwatch
from trackslip.errors import RunFailedError
from trackslip.identification.samples import usable_samples
from trackslip.localization.bound import scan_ratio_to_bound
from trackslip.logs.logfile import write_parquet
from trackslip.logs.runlog import RunLog
from trackslip.slip.icr import ConstantIcr
from trackslip.trajectory.segmented import circle

CONFIG = Config(radii=(0.5, 1.0, 1.5), speeds=(0.2,), duration=4.0)


def stored(logs):
    file = io.BytesIO()
    write_parquet(logs, file)
    return file.getvalue()


def drive_grid(pool, watch):
    """Logs of a small grid, and what was measured of them."""
    shares = list(grid_shares(CONFIG, cells_of(CONFIG), pool))
    return joined(shares, watch), {name: one for share in shares for name, one in share.measured.items()}


def grid_and_loops(threads):
    """Bytes of a small grid and of closed loops, and samples of the grid by every method."""
    watch = Stopwatch()
    with workers("processes", threads) as pool:
        grid, measured = drive_grid(pool, watch)
        driven = joined(list(closed_loop_shares(CONFIG, LAWS, PATH, pool)), watch)
    assert min(watch.stages.values()) > 0
    samples = {
        run: {name: one.slip.tolist() for name, one in known.by_method.items()} for run, known in measured.items()
    }
    assert [log.run for log in driven] == [f"{name} {law}" for name in CONTROLLERS for law in LAWS]
    return stored(grid), stored(driven), samples


LAWS = {**KNOWN_LAWS, "icr": ConstantIcr(0.04, half_gauge=0.168)}
PATH = circle(1.0, 0.2, 0.5)


def test_any_number_of_workers_gives_the_same_bits():
    alone = grid_and_loops(1)
    assert len(alone[2]) == 3
    assert grid_and_loops(2) == alone
    assert grid_and_loops(5) == alone  # more than runs of the grid


def test_what_was_measured_with_the_runs_is_what_they_give():
    with workers("inline", 1) as pool:
        logs, measured = drive_grid(pool, Stopwatch())
    geometry = load_robot().geometry
    fresh, known = (usable_samples(logs, geometry, longest=True, measured=one) for one in ({}, measured))
    for name in ("omega", "twist", "slip", "covariance", "lateral", "lateral_stderr"):
        np.testing.assert_array_equal(getattr(known.samples, name), getattr(fresh.samples, name))
    assert (known.samples.run, known.refused, known.notes) == (fresh.samples.run, fresh.refused, fresh.notes)
    assert known.steady_share == pytest.approx(fresh.steady_share)
    summary = [
        grid_summary(CONFIG, fresh.samples.run, given, fresh.samples, geometry, Stopwatch(), one).to_json()
        for given, one in ((logs, {}), (logs, measured), (one_at_a_time(logs), {}))
    ]
    assert summary[0] == summary[1] == summary[2]


def one_at_a_time(logs):
    """Copies of logs, each of which must be forgotten before the next one is asked for, but for one."""
    given = []
    for log in logs:
        gc.collect()
        assert sum(one() is not None for one in given) <= 1
        copy = replace(log)
        given.append(weakref.ref(copy))
        yield copy
        del copy


def test_pose_errors_and_bound_of_a_grid_are_those_of_all_its_poses_together():
    with workers("inline", 1) as pool:
        logs, _ = drive_grid(pool, Stopwatch())
    error = np.concatenate([log.pose - log.truth.pose for log in logs])
    error[:, 2] = np.angle(np.exp(1j * error[:, 2]))
    found, bound = LocalizationErrors.of(iter(logs)), _PosesOverBound()
    rmse = np.sqrt(np.mean(error**2, axis=0))
    np.testing.assert_allclose((found.rmse_x, found.rmse_y, found.rmse_heading), rmse, rtol=1e-12)
    assert found.valid_fraction == np.mean([log.is_valid.mean() for log in logs])
    assert found.rate_hz == pytest.approx(20 * found.valid_fraction)
    for log in logs:
        bound.add(log)
    lean = [log.truth.lean[:, None] * axis_left(log.truth.pose[:, 2]) for log in logs]
    true = [log.truth.pose + off for log, off in zip(logs, lean, strict=True)]
    valid = [log.is_valid for log in logs]
    estimated, true = (
        np.concatenate([pose[rows] for pose, rows in zip(poses, valid, strict=True)])
        for poses in ([log.pose for log in logs], true)
    )
    ratio = scan_ratio_to_bound(estimated, true, logs[0].scans.plate, logs[0].scans.scan)
    np.testing.assert_allclose(list(vars(bound.ratio()).values()), ratio, rtol=1e-12)
    bound.add(replace(logs[0], scans=None))
    assert bound.ratio() is None


def axis_left(phi):
    return np.column_stack([-np.sin(phi), np.cos(phi), 0 * phi])


def log(name, rows):
    time = np.arange(rows) / 10
    return RunLog(name, time, np.zeros((rows, 2)), np.zeros((rows, 3)), metadata={"of": name})


def test_all_runs_end_with_the_earliest_failure():
    late, early = RunFailedError("run 'b': tips over"), RunFailedError("run 'c': tips over")
    shares = [Share([log("a", 20)], {}), Share([log("b", 15)], {}, late), Share([log("c", 7)], {}, early)]
    with pytest.raises(RunFailedError, match="run 'c'") as caught:
        joined(pickle.loads(pickle.dumps(shares)), Stopwatch())
    assert [len(one.time) for one in caught.value.logs] == [7, 7, 7]
    assert {one.metadata[FAILURE] for one in caught.value.logs} == {"run 'c': tips over"}


def test_a_failure_at_once_leaves_no_runs():
    shares = [Share([log("a", 20)], {}), Share([], {}, RunFailedError("run 'b': tips over"))]
    with pytest.raises(RunFailedError) as caught:
        joined(shares, Stopwatch())
    assert caught.value.logs == []


@pytest.mark.slow
@pytest.mark.usefixtures("few_resamples")
def test_the_whole_command_gives_the_same_bits(trackslip, tmp_path):
    small = ("--radii", "0.6", "1.5", "--speeds", "0.1", "0.2", "--duration", "8")
    found = []
    for threads in ("1", "2", "3"):
        result = trackslip("reproduce", *small, "--threads", threads, "--out", str(tmp_path / threads))
        files = {path.name: path.read_bytes() for path in (result.folder / "figures").iterdir()}
        result.summary["localization"].pop("scans_per_s")
        numbers = json.dumps({key: value for key, value in result.summary.items() if key != "timing"})
        found.append((files, numbers, (result.folder / "runs.parquet").read_bytes()))
    assert found[0] == found[1] == found[2]
