"""Poses over time -> smooth poses and the body twist."""

from trackslip.motion.base import Motion, MotionMethod, SteadyTwist
from trackslip.motion.filtered import butterworth_motion, difference
from trackslip.motion.methods import MOTION_METHODS, best_method
from trackslip.motion.stationarity import require_steady_motion

__all__ = [
    "MOTION_METHODS",
    "Motion",
    "MotionMethod",
    "SteadyTwist",
    "best_method",
    "butterworth_motion",
    "difference",
    "require_steady_motion",
]
