"""Slip of tracked robots: kinematics, localization, identification and control. Needs no simulator.

    import trackslip

    found = trackslip.identify("out/grid")
    found.laws[found.best]

The names below are imported when they are first used, so that `import trackslip` is quick.
"""

from __future__ import annotations

import importlib

# Type checkers take it as true; importing `typing` would take longer than everything else here.
TYPE_CHECKING = False
if TYPE_CHECKING:  # "X as X" marks a public name (PEP 484)
    from trackslip.controllers.base import Controller as Controller
    from trackslip.controllers.dynamic_feedback import DynamicFeedback as DynamicFeedback
    from trackslip.controllers.feedforward import Feedforward as Feedforward
    from trackslip.controllers.kanayama import Kanayama as Kanayama
    from trackslip.controllers.linear import LinearTimeVarying as LinearTimeVarying
    from trackslip.controllers.lqr import Lqr as Lqr
    from trackslip.controllers.mpc import ModelPredictive as ModelPredictive
    from trackslip.controllers.offset_point import OffsetPoint as OffsetPoint
    from trackslip.controllers.pure_pursuit import PurePursuit as PurePursuit
    from trackslip.controllers.samson import Samson as Samson
    from trackslip.controllers.stanley import Stanley as Stanley
    from trackslip.deploy.deploy import deploy_law as deploy_law
    from trackslip.errors import InvalidValueError as InvalidValueError
    from trackslip.errors import LogError as LogError
    from trackslip.errors import LogWarning as LogWarning
    from trackslip.errors import OutputError as OutputError
    from trackslip.errors import TrackslipError as TrackslipError
    from trackslip.identification.identify import identify as identify
    from trackslip.identification.result import Identification as Identification
    from trackslip.kinematics import RobotGeometry as RobotGeometry
    from trackslip.localization.base import PoseEstimate as PoseEstimate
    from trackslip.localization.plate import PlateLocator as PlateLocator
    from trackslip.localization.scan import Plate as Plate
    from trackslip.logs.runlog import RunLog as RunLog
    from trackslip.metrics import TrackingErrors as TrackingErrors
    from trackslip.metrics import body_errors as body_errors
    from trackslip.metrics import expense as expense
    from trackslip.metrics import tracking_errors as tracking_errors
    from trackslip.odometry.evaluation import OdometryErrors as OdometryErrors
    from trackslip.odometry.evaluation import odometry_errors as odometry_errors
    from trackslip.odometry.identified import identified_law as identified_law
    from trackslip.odometry.slip_odometry import SlipOdometry as SlipOdometry
    from trackslip.odometry.tum import write_tum as write_tum
    from trackslip.odometry.uncertainty import LawErrors as LawErrors
    from trackslip.odometry.uncertainty import SlipNoise as SlipNoise
    from trackslip.planning.information import PoseQuality as PoseQuality
    from trackslip.planning.limits import DriveLimits as DriveLimits
    from trackslip.planning.plan import DrivePlan as DrivePlan
    from trackslip.planning.plan import plan_drive as plan_drive
    from trackslip.ros.any_log import load as load
    from trackslip.ros.choice import BagChoice as BagChoice
    from trackslip.ros.writer import write_bag as write_bag
    from trackslip.se2 import Mounting as Mounting
    from trackslip.slip.base import SlipLaw as SlipLaw
    from trackslip.slip.compensation import FixedLaw as FixedLaw
    from trackslip.slip.compensation import LoadedLaw as LoadedLaw
    from trackslip.slip.compensation import LoadedOnlineIcr as LoadedOnlineIcr
    from trackslip.slip.compensation import OnlineIcr as OnlineIcr
    from trackslip.slip.constant import Constant as Constant
    from trackslip.slip.constant import NoSlip as NoSlip
    from trackslip.slip.exponential import PUBLISHED as PUBLISHED
    from trackslip.slip.exponential import Exponential as Exponential
    from trackslip.slip.exponential import ExponentialSpeed as ExponentialSpeed
    from trackslip.slip.icr import ConstantIcr as ConstantIcr
    from trackslip.slip.icr import IcrSides as IcrSides
    from trackslip.slip.icr_load import IcrLoad as IcrLoad
    from trackslip.slip.law_file import load_laws as load_laws
    from trackslip.slip.law_file import save_laws as save_laws
    from trackslip.slip.online import IcrFilter as IcrFilter
    from trackslip.slip.turn_loss import TurnLoss as TurnLoss
    from trackslip.trajectory.base import Reference as Reference
    from trackslip.trajectory.named import named_reference as named_reference
    from trackslip.trajectory.segmented import circle as circle
    from trackslip.trajectory.segmented import paper_reference as paper_reference
    from trackslip.trajectory.waypoints import read_waypoints as read_waypoints
    from trackslip.trajectory.waypoints import waypoints as waypoints

    __version__: str

_NAMES = {
    "controllers.base": ("Controller",),
    "controllers.dynamic_feedback": ("DynamicFeedback",),
    "controllers.feedforward": ("Feedforward",),
    "controllers.kanayama": ("Kanayama",),
    "controllers.linear": ("LinearTimeVarying",),
    "controllers.lqr": ("Lqr",),
    "controllers.mpc": ("ModelPredictive",),
    "controllers.offset_point": ("OffsetPoint",),
    "controllers.pure_pursuit": ("PurePursuit",),
    "controllers.samson": ("Samson",),
    "controllers.stanley": ("Stanley",),
    "deploy.deploy": ("deploy_law",),
    "errors": ("InvalidValueError", "LogError", "LogWarning", "OutputError", "TrackslipError"),
    "identification.identify": ("identify",),
    "identification.result": ("Identification",),
    "kinematics": ("RobotGeometry",),
    "localization.base": ("PoseEstimate",),
    "localization.plate": ("PlateLocator",),
    "localization.scan": ("Plate",),
    "logs.runlog": ("RunLog",),
    "metrics": ("TrackingErrors", "body_errors", "expense", "tracking_errors"),
    "odometry.evaluation": ("OdometryErrors", "odometry_errors"),
    "odometry.identified": ("identified_law",),
    "se2": ("Mounting",),
    "odometry.slip_odometry": ("SlipOdometry",),
    "odometry.tum": ("write_tum",),
    "odometry.uncertainty": ("LawErrors", "SlipNoise"),
    "planning.information": ("PoseQuality",),
    "planning.limits": ("DriveLimits",),
    "planning.plan": ("DrivePlan", "plan_drive"),
    "ros.any_log": ("load",),
    "ros.choice": ("BagChoice",),
    "ros.writer": ("write_bag",),
    "slip.base": ("SlipLaw",),
    "slip.compensation": ("FixedLaw", "LoadedLaw", "LoadedOnlineIcr", "OnlineIcr"),
    "slip.constant": ("Constant", "NoSlip"),
    "slip.exponential": ("PUBLISHED", "Exponential", "ExponentialSpeed"),
    "slip.icr": ("ConstantIcr", "IcrSides"),
    "slip.icr_load": ("IcrLoad",),
    "slip.law_file": ("load_laws", "save_laws"),
    "slip.online": ("IcrFilter",),
    "slip.turn_loss": ("TurnLoss",),
    "trajectory.base": ("Reference",),
    "trajectory.named": ("named_reference",),
    "trajectory.segmented": ("circle", "paper_reference"),
    "trajectory.waypoints": ("read_waypoints", "waypoints"),
}
_MODULE_OF = {name: module for module, names in _NAMES.items() for name in names}

if not TYPE_CHECKING:
    __all__ = sorted([*_MODULE_OF, "__version__"])

    def __getattr__(name: str) -> object:
        if name == "__version__":
            value = importlib.import_module("importlib.metadata").version("trackslip")
        elif name in _MODULE_OF:
            value = getattr(importlib.import_module(f"trackslip.{_MODULE_OF[name]}"), name)
        else:
            raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
        globals()[name] = value
        return value


def __dir__() -> list[str]:
    return sorted({*globals(), *_MODULE_OF})
