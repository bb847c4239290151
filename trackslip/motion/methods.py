"""Motion methods by name."""

from __future__ import annotations

from trackslip.logs.runlog import RunLog
from trackslip.motion.arc import arc
from trackslip.motion.bundle import bundle
from trackslip.motion.filtered import paper
from trackslip.motion.steady_twist import MotionMethod

MOTION_METHODS: dict[str, MotionMethod] = {
    "paper": paper,
    "arc": arc,
    "bundle": bundle,
}
"""Methods that find the twist of a steady run: first the paper's as printed, last the most accurate."""


def best_method(log: RunLog) -> str:
    """The most accurate method that a run allows: from its ranges if it has any, else from its poses."""
    return "arc" if log.scans is None else "bundle"
