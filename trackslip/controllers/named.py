"""The table of controllers by name."""

from __future__ import annotations

from typing import Final

from trackslip.controllers.base import Controller
from trackslip.controllers.feedback import (
    DynamicFeedback,
    Feedforward,
    Kanayama,
    LinearTimeVarying,
    Lqr,
    OffsetPoint,
    Samson,
)
from trackslip.controllers.path_following import PathFollowing
from trackslip.controllers.predictive import LinearPredictive, ModelPredictive, PathIntegral
from trackslip.controllers.steering import PurePursuit, RegulatedPurePursuit, Stanley

CONTROLLERS: Final[dict[str, type[Controller]]] = {
    "feedforward": Feedforward,
    "linear": LinearTimeVarying,
    "samson": Samson,
    "kanayama": Kanayama,
    "dynamic_feedback": DynamicFeedback,
    "offset_point": OffsetPoint,
    "pure_pursuit": PurePursuit,
    "regulated_pure_pursuit": RegulatedPurePursuit,
    "stanley": Stanley,
    "path_following": PathFollowing,
    "lqr": Lqr,
    "ltv_mpc": LinearPredictive,
    "mpc": ModelPredictive,
    "mppi": PathIntegral,
}
"""Controllers by their names on the command line."""
TURNING_CONTROLLERS: Final = ", ".join(
    name
    for name, controller in CONTROLLERS.items()
    if getattr(controller, "turns_on_the_spot", True)
)
"""Names of the controllers that turn on the spot where their reference does."""
