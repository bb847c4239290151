"""Poses over time -> smooth poses and the body twist."""

from trackslip.motion.base import Motion, MotionMethod, SteadyTwist
from trackslip.motion.filtered import butterworth_motion, difference
from trackslip.motion.methods import DEFAULT_METHOD, MOTION_METHODS
from trackslip.motion.stationarity import require_steady_motion

__all__ = [
    "DEFAULT_METHOD",
    "MOTION_METHODS",
    "Motion",
    "MotionMethod",
    "SteadyTwist",
    "butterworth_motion",
    "difference",
    "require_steady_motion",
]
