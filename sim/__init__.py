"""The simulated world: tracked robots on MuJoCo grounds, and the laser range finder that watches them.

    import numpy as np
    import sim

    fleet = sim.Fleet(sim.load_robot(), np.zeros((2, 3)))
    logs = sim.open_loop(fleet, np.array([[2.0, 3.0], [3.0, 4.0]]), duration=10.0)

The names below are imported when first used. Importing this package registers the environments
trackslip/PathTracking-v0 and trackslip/Traverse-v0: `gymnasium.make("sim:trackslip/PathTracking-v0")`.
"""

from __future__ import annotations

import contextlib
import importlib
from typing import TYPE_CHECKING

if TYPE_CHECKING:  # "X as X" marks a public name (PEP 484)
    from sim.drive.drive import Drive as Drive
    from sim.drive.pull import Pull as Pull
    from sim.fleet import Fleet as Fleet
    from sim.ground.ground import Ground as Ground
    from sim.ground.named import load_ground as load_ground
    from sim.loop import closed_loop as closed_loop
    from sim.loop import open_loop as open_loop
    from sim.pilot import Pilot as Pilot
    from sim.robot.parameters import RobotParameters as RobotParameters
    from sim.robot.robot import load_robot as load_robot
    from sim.robot.tracked import Flipper as Flipper
    from sim.robot.tracked import TrackedRobot as TrackedRobot
    from sim.robot.tracked import load_tracked as load_tracked
    from sim.robot.tracked_model import TrackedModel as TrackedModel
    from sim.robot.tracked_model import build_tracked as build_tracked
    from sim.run_recorder import Description as Description
    from sim.scanner.feed import ScannerFeed as ScannerFeed
    from sim.scanner.obstacles import load_obstacles as load_obstacles
    from sim.scanner.scanner import LaserScanner as LaserScanner
    from sim.traverse.outcome import Outcome as Outcome
    from sim.traverse.policy import Scripted as Scripted
    from sim.traverse.reflex import Reflex as Reflex
    from sim.traverse.world import Command as Command
    from sim.traverse.world import Traverse as Traverse
    from trackslip.errors import RunFailedError as RunFailedError

_NAMES = {
    "drive.drive": ("Drive",),
    "drive.pull": ("Pull",),
    "fleet": ("Fleet",),
    "ground.ground": ("Ground",),
    "ground.named": ("load_ground",),
    "loop": ("closed_loop", "open_loop"),
    "pilot": ("Pilot",),
    "robot.parameters": ("RobotParameters",),
    "robot.robot": ("load_robot",),
    "robot.tracked": ("Flipper", "TrackedRobot", "load_tracked"),
    "robot.tracked_model": ("TrackedModel", "build_tracked"),
    "run_recorder": ("Description", "RunFailedError"),
    "scanner.feed": ("ScannerFeed",),
    "scanner.obstacles": ("load_obstacles",),
    "scanner.scanner": ("LaserScanner",),
    "traverse.outcome": ("Outcome",),
    "traverse.policy": ("Scripted",),
    "traverse.reflex": ("Reflex",),
    "traverse.world": ("Command", "Traverse"),
}
_MODULE_OF = {name: module for module, names in _NAMES.items() for name in names}

if not TYPE_CHECKING:
    __all__ = sorted(_MODULE_OF)

    def __getattr__(name: str) -> object:
        if name not in _MODULE_OF:
            raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
        globals()[name] = value = getattr(importlib.import_module(f"sim.{_MODULE_OF[name]}"), name)
        return value


def __dir__() -> list[str]:
    return sorted({*globals(), *_MODULE_OF})


with contextlib.suppress(ImportError):  # sim.tracks and sim.terrain do without gymnasium
    import gymnasium

    gymnasium.register(
        id="trackslip/PathTracking-v0",
        entry_point="sim.env:PathTrackingEnv",
        vector_entry_point="sim.env:PathTrackingVectorEnv",
    )
    gymnasium.register(
        id="trackslip/Traverse-v0",
        entry_point="sim.env:TraverseEnv",
        vector_entry_point="sim.env:TraverseVectorEnv",
    )
