"""Poses over time -> smooth poses and the body twist."""

from trackslip.motion.base import Motion, MotionMethod, SteadyTwist
from trackslip.motion.filtered import butterworth_motion, difference

__all__ = ["Motion", "MotionMethod", "SteadyTwist", "butterworth_motion", "difference"]
