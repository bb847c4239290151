"""The public names, and where they are; `__init__.py` imports each when it is first used."""

from .drive.drive import Drive as Drive
from .drive.pull import Pull as Pull
from .fleet import Fleet as Fleet
from .ground.ground import Ground as Ground
from .ground.named import load_ground as load_ground
from .log_replay import replay as replay
from .loop import closed_loop as closed_loop
from .loop import open_loop as open_loop
from .pilot import Pilot as Pilot
from .robot.named import load_tracked as load_tracked
from .robot.parameters import RobotParameters as RobotParameters
from .robot.robot import load_robot as load_robot
from .robot.tracked import Flipper as Flipper
from .robot.tracked import TrackedRobot as TrackedRobot
from .robot.tracked_model import TrackedModel as TrackedModel
from .robot.tracked_model import build_tracked as build_tracked
from .run_recorder import Description as Description
from .run_recorder import RunFailedError as RunFailedError
from .scanner.feed import ScannerFeed as ScannerFeed
from .scanner.obstacles import load_obstacles as load_obstacles
from .scanner.scanner import LaserScanner as LaserScanner
from .traverse.outcome import Outcome as Outcome
from .traverse.policy import Scripted as Scripted
from .traverse.reflex import Reflex as Reflex
from .traverse.world import Command as Command
from .traverse.world import Traverse as Traverse
