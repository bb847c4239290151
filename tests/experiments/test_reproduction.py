"""`reproduce`: the numbers of its grid, and the same results with any number of threads."""

import json
from dataclasses import replace

import numpy as np
import pytest

from experiments.commands.reproduce import Config
from experiments.driving.grid_runs import drive_grid
from experiments.driving.world import World
from experiments.measuring.grid import LocalizationErrors, _PosesOverBound, grid_summary, measured_run
from sim.robot.robot import load_robot
from sim.stopwatch import Stopwatch
from trackslip.identification.samples import usable_samples
from trackslip.localization.bound import scan_ratio_to_bound

CONFIG = Config(radii=(0.5, 1.0, 1.5), speeds=(0.2,), duration=4.0)


@pytest.fixture(scope="module")
def logs():
    """The runs of a small grid."""
    return drive_grid(CONFIG, World.of(CONFIG))


def test_runs_that_were_measured_before_give_the_same(logs):
    geometry = load_robot().geometry
    measured = {log.run: measured_run(log, geometry) for log in logs}
    fresh, known = (usable_samples(logs, geometry, longest=True, measured=one) for one in ({}, measured))
    for name in ("omega", "twist", "slip", "covariance", "lateral", "lateral_stderr"):
        np.testing.assert_array_equal(getattr(known.samples, name), getattr(fresh.samples, name))
    assert (known.samples.run, known.refused, known.notes) == (fresh.samples.run, fresh.refused, fresh.notes)
    assert known.steady_share == pytest.approx(fresh.steady_share)
    summary = [
        grid_summary(CONFIG, fresh.samples.run, given, fresh.samples, geometry, Stopwatch(), one).to_json()
        for given, one in ((logs, {}), (logs, measured))
    ]
    assert summary[0] == summary[1]


def test_pose_errors_and_bound_of_a_grid_are_those_of_all_its_poses_together(logs):
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
