"""`trackslip localize`, and poses of a scanned plate in other commands."""

import json

import numpy as np
import pytest
from beside import drive, room, teleoperated
from scanned import other_poses, write_session

from experiments.cli import main, parse
from experiments.identify.config import source_of
from trackslip.logs.logfile import read_runs

PLATE = ("--plate", "0.6x0.04")
OFF = (0.05, 0.10, np.radians(5.0))


@pytest.fixture(scope="module")
def driven():
    rng = np.random.default_rng(1)
    return drive(teleoperated(rng, 20.0, 4.0), things=room(), place=OFF, beams=241)


@pytest.fixture(scope="module")
def bag(tmp_path_factory, driven):
    return write_session(tmp_path_factory.mktemp("scanned") / "run", "foxglove", driven, other_poses(driven))


def test_the_plate_is_located_and_its_poses_are_stored(bag, driven, tmp_path, capsys):
    main(["localize", str(bag), *PLATE, "--scan", "/scan", "--mount", *map(str, driven.mount), "--out", str(tmp_path)])
    printed = capsys.readouterr().out
    assert "scanner: x = 0.000 m, y = 0.000 m, yaw = 90.00°, as given" in printed
    assert "warning" not in printed
    (log,) = read_runs(tmp_path / "runs.parquet")
    valid = log.is_valid
    true = driven.path(log.time[valid])
    assert np.hypot(*(log.pose[valid] - true)[:, :2].T).max() < 0.03
    (one,) = json.loads((tmp_path / "summary.json").read_text())["drives"]
    assert (one["located"], one["scans"]) == (valid.sum(), len(driven.time))
    assert one["noise"] == pytest.approx(0.005, rel=0.05)
    for name, expected in zip(("x", "y", "yaw"), OFF, strict=True):
        assert abs(one["plate_on_robot"][name] - expected) < 4 * one["plate_on_robot_stderr"][name]
    assert (tmp_path / "figures" / "field.svg").read_text().startswith("<?xml")


def test_identify_takes_the_same_poses_and_ranges(bag, driven):
    robot = ("--half-gauge", "0.168", "--sprocket-radius", "0.06")
    config = parse(["identify", str(bag), *PLATE, "--mount", "0", "0", "1.5708", *robot])
    source = source_of(config)
    (log,) = source.logs
    assert log.scans is not None
    assert "the plate's in /scan" in source.taken[0]
    assert np.hypot(*(log.pose[log.is_valid] - driven.path(log.time[log.is_valid]))[:, :2].T).max() < 0.03


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ("--plate nanx0.1", "plate = 'nanx0.1': must be LENGTHxTHICKNESS in m, as in 0.5x0.02, longer than thick"),
        ("--plate 0.02x0.5", "plate = '0.02x0.5': must be LENGTHxTHICKNESS"),
        ("--plate 0.6x0.04 --mount 0 inf 0", "mount = (0.0, inf, 0.0): must be three finite numbers"),
        ("--plate 0.1x0.02", "no plate of 0.1x0.02 m moves as the encoders say"),
    ],
)
def test_mistakes_cost_one_line_and_leave_nothing(bag, refused, options, said):
    assert said in refused("localize", str(bag), *options.split())
