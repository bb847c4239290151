"""Slip of tracked robots: kinematics, localization, identification and control. Needs no simulator.

    import trackslip

    found = trackslip.identify("out/grid")
    found.laws[found.best]

The names below are imported when they are first used, so that `import trackslip` is quick.
"""

from __future__ import annotations

import importlib

TYPE_CHECKING = False  # type checkers take it as true; importing `typing` would take longer than everything else here
if TYPE_CHECKING:
    from trackslip.controllers.base import Controller
    from trackslip.controllers.dynamic_feedback import DynamicFeedback
    from trackslip.controllers.feedforward import Feedforward
    from trackslip.controllers.kanayama import Kanayama
    from trackslip.controllers.linear import LinearTimeVarying
    from trackslip.controllers.lqr import Lqr
    from trackslip.controllers.mpc import ModelPredictive
    from trackslip.controllers.offset_point import OffsetPoint
    from trackslip.controllers.pure_pursuit import PurePursuit
    from trackslip.controllers.samson import Samson
    from trackslip.controllers.stanley import Stanley
    from trackslip.errors import InvalidValueError, LogError, OutputError, TrackslipError
    from trackslip.identification.identify import identify
    from trackslip.identification.result import Identification
    from trackslip.kinematics import RobotGeometry
    from trackslip.localization.base import PoseEstimate
    from trackslip.localization.plate import PlateLocator
    from trackslip.logs.logfile import load
    from trackslip.logs.runlog import RunLog
    from trackslip.metrics import TrackingErrors, body_errors, expense, tracking_errors
    from trackslip.slip.base import SlipLaw
    from trackslip.slip.compensation import FixedLaw, OnlineIcr
    from trackslip.slip.constant import Constant, NoSlip
    from trackslip.slip.exponential import PUBLISHED, Exponential, ExponentialSpeed
    from trackslip.slip.icr import ConstantIcr, IcrSides
    from trackslip.slip.law_file import load_laws, save_laws
    from trackslip.slip.online import IcrFilter
    from trackslip.slip.power import Hyperbola, Power
    from trackslip.trajectory.base import Reference
    from trackslip.trajectory.named import named_reference
    from trackslip.trajectory.segmented import circle, paper_reference
    from trackslip.trajectory.waypoints import read_waypoints, waypoints

    __version__: str

__all__ = [
    "PUBLISHED",
    "Constant",
    "ConstantIcr",
    "Controller",
    "DynamicFeedback",
    "Exponential",
    "ExponentialSpeed",
    "Feedforward",
    "FixedLaw",
    "Hyperbola",
    "IcrFilter",
    "IcrSides",
    "Identification",
    "InvalidValueError",
    "Kanayama",
    "LinearTimeVarying",
    "LogError",
    "Lqr",
    "ModelPredictive",
    "NoSlip",
    "OffsetPoint",
    "OnlineIcr",
    "OutputError",
    "PlateLocator",
    "PoseEstimate",
    "Power",
    "PurePursuit",
    "Reference",
    "RobotGeometry",
    "RunLog",
    "Samson",
    "SlipLaw",
    "Stanley",
    "TrackingErrors",
    "TrackslipError",
    "__version__",
    "body_errors",
    "circle",
    "expense",
    "identify",
    "load",
    "load_laws",
    "named_reference",
    "paper_reference",
    "read_waypoints",
    "save_laws",
    "tracking_errors",
    "waypoints",
]

_MODULE_OF = {
    "PUBLISHED": "slip.exponential",
    "Constant": "slip.constant",
    "ConstantIcr": "slip.icr",
    "Controller": "controllers.base",
    "DynamicFeedback": "controllers.dynamic_feedback",
    "Exponential": "slip.exponential",
    "ExponentialSpeed": "slip.exponential",
    "Feedforward": "controllers.feedforward",
    "FixedLaw": "slip.compensation",
    "Hyperbola": "slip.power",
    "IcrFilter": "slip.online",
    "IcrSides": "slip.icr",
    "Identification": "identification.result",
    "InvalidValueError": "errors",
    "Kanayama": "controllers.kanayama",
    "LinearTimeVarying": "controllers.linear",
    "LogError": "errors",
    "Lqr": "controllers.lqr",
    "ModelPredictive": "controllers.mpc",
    "NoSlip": "slip.constant",
    "OffsetPoint": "controllers.offset_point",
    "OnlineIcr": "slip.compensation",
    "OutputError": "errors",
    "PlateLocator": "localization.plate",
    "PoseEstimate": "localization.base",
    "Power": "slip.power",
    "PurePursuit": "controllers.pure_pursuit",
    "Reference": "trajectory.base",
    "RobotGeometry": "kinematics",
    "RunLog": "logs.runlog",
    "Samson": "controllers.samson",
    "SlipLaw": "slip.base",
    "Stanley": "controllers.stanley",
    "TrackingErrors": "metrics",
    "TrackslipError": "errors",
    "body_errors": "metrics",
    "circle": "trajectory.segmented",
    "expense": "metrics",
    "identify": "identification.identify",
    "load": "logs.logfile",
    "load_laws": "slip.law_file",
    "named_reference": "trajectory.named",
    "paper_reference": "trajectory.segmented",
    "read_waypoints": "trajectory.waypoints",
    "save_laws": "slip.law_file",
    "tracking_errors": "metrics",
    "waypoints": "trajectory.waypoints",
}

if not TYPE_CHECKING:

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
    return sorted({*globals(), *__all__})
