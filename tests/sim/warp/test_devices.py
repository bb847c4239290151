"""Devices on which a fleet's physics runs, where MuJoCo Warp or a GPU is missing."""

import numpy as np
import pytest

from experiments.options.bench import BenchConfig
from experiments.work import bench
from sim.fleet import Fleet
from sim.warp import devices
from trackslip.errors import InvalidValueError, TrackslipError

START = np.zeros((1, 3))


def test_an_unknown_device_is_refused(robot):
    with pytest.raises(InvalidValueError, match="device = 'tpu': must be one of cpu, gpu, warp-cpu"):
        Fleet(robot, START, device="tpu")


@pytest.mark.parametrize("device", ["gpu", "warp-cpu"])
def test_without_mujoco_warp_the_error_says_what_to_install(robot, monkeypatch, device):
    monkeypatch.setattr(devices, "find_spec", lambda name: None)
    with pytest.raises(TrackslipError) as error:
        Fleet(robot, START, device=device)
    assert str(error.value) == f"device '{device}' needs MuJoCo Warp: pip install \"trackslip[gpu]\""


@pytest.fixture
def no_driver(monkeypatch):
    """MuJoCo Warp is installed, but there is no driver of a GPU."""
    monkeypatch.setattr(devices, "find_spec", lambda name: object())
    monkeypatch.setattr(devices, "_DRIVERS", ("no-such-driver.so",))


def test_without_a_gpu_the_error_says_so(robot, no_driver):
    with pytest.raises(TrackslipError, match="needs an NVIDIA GPU and its driver; this computer has none"):
        Fleet(robot, START, device="gpu")


def test_bench_without_a_gpu_leaves_nothing(no_driver, tmp_path):
    with pytest.raises(TrackslipError, match="needs an NVIDIA GPU"):
        bench.run(BenchConfig(gpu=True, out=tmp_path / "bench"))
    assert not (tmp_path / "bench").exists()


def test_bench_measures_as_many_robots_as_it_is_told_to():
    assert BenchConfig(gpu=True).gpu_sizes == (1024, 4096, 16_384, 65_536)
    assert BenchConfig(gpu=True, sizes=(20_000,)).gpu_sizes == (20_000,)
    with pytest.raises(InvalidValueError, match="seconds"):
        BenchConfig(gpu=True, seconds=5.0)
