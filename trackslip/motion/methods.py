"""Motion methods by name."""

from __future__ import annotations

from collections.abc import Callable

from trackslip.logs.runlog import RunLog
from trackslip.motion.arc import arc
from trackslip.motion.base import Motion, MotionMethod, SteadyTwist
from trackslip.motion.bundle import bundle
from trackslip.motion.filtered import butterworth_motion, mean_twist, paper_motion


def _mean_of(motion: Callable[[RunLog], Motion]) -> MotionMethod:
    def method(log: RunLog, window: tuple[float, float]) -> SteadyTwist:
        return mean_twist(motion(log), log, window)

    return method


MOTION_METHODS: dict[str, MotionMethod] = {
    "paper": _mean_of(paper_motion),
    "butterworth": _mean_of(butterworth_motion),
    "arc": arc,
    "bundle": bundle,
}
"""Methods that find the twist of a steady run: first the paper's as printed, last the most accurate."""


def best_method(log: RunLog) -> str:
    """The most accurate method that a run allows: from its ranges if it has any, else from its poses."""
    return "arc" if log.scans is None else "bundle"
