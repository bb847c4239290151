"""What several tests share."""

import os
import signal
import sys
from dataclasses import replace
from pathlib import Path

if sys.platform == "linux" and not (os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")):
    os.environ.setdefault("MUJOCO_GL", "egl")  # MuJoCo reads it when it is imported

import numpy as np
import pytest
from beside import rectangle
from hypothesis import settings

from sim.robot.robot import Robot, load_robot
from trackslip.kinematics import Array, RobotGeometry
from trackslip.laws.families import FAMILIES
from trackslip.localization.scan import Plate, Scan

settings.register_profile("trackslip", deadline=None, max_examples=15)  # a busy machine is no error
settings.load_profile("trackslip")
# as in a shell's background, which the commands would inherit
if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)

CORE = (
    "trackslip/test_kinematics",
    "trackslip/laws",
    "trackslip/controllers",
    "trackslip/odometry",
    "trackslip/identification/test_windows",
    "sim/tracks",
    "sim/fleet",
    "sim/runs/test_loop",
)
"""Tests of the method, of tracks and of the closed loop: those to run after every change."""


def pytest_collection_modifyitems(items):
    for item in items:
        place = item.path.relative_to(Path(__file__).parent).as_posix()
        if place.startswith(CORE) and not item.get_closest_marker("slow"):
            item.add_marker("core")


@pytest.fixture(scope="session")
def robot() -> Robot:
    return load_robot()


@pytest.fixture
def geometry() -> RobotGeometry:
    return RobotGeometry(half_gauge=0.168, sprocket_radius=0.06)


@pytest.fixture
def few_laws(monkeypatch):
    """Fits of three laws to steady samples, for tests of what all laws share: others take
    seconds.
    """
    laws = {name: FAMILIES[name] for name in ("none", "icr_radius", "diff_drive")}
    monkeypatch.setattr("trackslip.identification.steady.FAMILIES", laws)


@pytest.fixture(scope="session")
def scan_rectangle():
    """A scanner of its own, with formulas for rays to a rectangle."""

    def scan(
        poses: Array,
        rng: np.random.Generator,
        noise: float = 0.005,
        mount: tuple[float, float, float] = (0.0, 0.0, 0.0),
        plate: Plate | None = None,
        step: float = np.radians(0.25),
    ) -> Scan:
        plate = plate or Plate()
        half = round(np.pi / 2 / step)
        bearings = np.arange(-half, half + 1) * step
        directions = np.stack([np.cos(bearings), np.sin(bearings)], axis=-1)  # (B, 2)
        scanner = Scan(bearings, np.empty((0, len(bearings))), noise, np.array(mount))
        local = scanner.from_world(np.asarray(poses, float))
        seen = rectangle(local[:, None], (plate.length, plate.thickness))
        exact = seen(np.zeros(2), directions, np.zeros(1))
        ranges = np.where(np.isfinite(exact), exact + rng.normal(0, noise, exact.shape), np.nan)
        return replace(scanner, ranges=ranges)

    return scan
