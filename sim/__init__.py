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

if TYPE_CHECKING:
    from sim.drive.drive import Drive
    from sim.drive.pull import Pull
    from sim.fleet import Fleet
    from sim.ground.ground import Ground
    from sim.ground.named import load_ground
    from sim.robot.parameters import RobotParameters
    from sim.robot.robot import load_robot
    from sim.robot.tracked import Flipper, TrackedRobot, load_tracked
    from sim.robot.tracked_model import TrackedModel, build_tracked
    from sim.run_recorder import Description
    from sim.runs import closed_loop, open_loop
    from sim.scanner.feed import ScannerFeed
    from sim.scanner.obstacles import load_obstacles
    from sim.scanner.scanner import LaserScanner
    from sim.steering import Pilot
    from sim.traverse.outcome import Outcome
    from sim.traverse.policy import Scripted
    from sim.traverse.reflex import Reflex
    from sim.traverse.world import Command, Traverse
    from trackslip.errors import RunFailedError

__all__ = [
    "Command",
    "Description",
    "Drive",
    "Fleet",
    "Flipper",
    "Ground",
    "LaserScanner",
    "Outcome",
    "Pilot",
    "Pull",
    "Reflex",
    "RobotParameters",
    "RunFailedError",
    "ScannerFeed",
    "Scripted",
    "TrackedModel",
    "TrackedRobot",
    "Traverse",
    "build_tracked",
    "closed_loop",
    "load_ground",
    "load_obstacles",
    "load_robot",
    "load_tracked",
    "open_loop",
]

_MODULE_OF = {
    "Command": "traverse.world",
    "Description": "run_recorder",
    "Drive": "drive.drive",
    "Fleet": "fleet",
    "Flipper": "robot.tracked",
    "Ground": "ground.ground",
    "LaserScanner": "scanner.scanner",
    "Outcome": "traverse.outcome",
    "Pilot": "steering",
    "Pull": "drive.pull",
    "Reflex": "traverse.reflex",
    "RobotParameters": "robot.parameters",
    "RunFailedError": "run_recorder",
    "ScannerFeed": "scanner.feed",
    "Scripted": "traverse.policy",
    "TrackedModel": "robot.tracked_model",
    "TrackedRobot": "robot.tracked",
    "Traverse": "traverse.world",
    "build_tracked": "robot.tracked_model",
    "closed_loop": "runs",
    "load_ground": "ground.named",
    "load_obstacles": "scanner.obstacles",
    "load_robot": "robot.robot",
    "load_tracked": "robot.tracked",
    "open_loop": "runs",
}

if not TYPE_CHECKING:

    def __getattr__(name: str) -> object:
        if name not in _MODULE_OF:
            raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
        globals()[name] = value = getattr(importlib.import_module(f"sim.{_MODULE_OF[name]}"), name)
        return value


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})


with contextlib.suppress(ImportError):  # sim.tracks and sim.terrain do without gymnasium
    import gymnasium

    gymnasium.register(
        id="trackslip/PathTracking-v0",
        entry_point="sim.env:PathTrackingEnv",
        vector_entry_point="sim.env:PathTrackingVectorEnv",
    )
    gymnasium.register(
        id="trackslip/Traverse-v0",
        entry_point="sim.traverse.env:TraverseEnv",
        vector_entry_point="sim.traverse.env:TraverseVectorEnv",
    )
