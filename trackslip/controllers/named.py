"""Controllers by name."""

from __future__ import annotations

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

CONTROLLERS: dict[str, type[Controller]] = {
    "feedforward": Feedforward,
    "linear": LinearTimeVarying,
    "samson": Samson,
    "kanayama": Kanayama,
    "dynamic_feedback": DynamicFeedback,
    "offset_point": OffsetPoint,
    "pure_pursuit": PurePursuit,
    "stanley": Stanley,
    "lqr": Lqr,
    "mpc": ModelPredictive,
}
"""Controllers by their names on the command line."""
