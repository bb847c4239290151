"""The areas of `trackslip bench --pipeline`: each module of this package measures one of them against its bounds."""

import importlib
from collections.abc import Callable

from experiments.measuring.check import Check

Measure = Callable[[int, int, Callable[[str], None]], tuple[Check, ...]]
"""What each module calls `measure`: from seed, number of rounds, and what to call with a label after each round."""

AREAS = (
    "physics",
    "environments",
    "closed_loop",
    "localization",
    "laws",
    "reproduce",
    "scale",
)
"""Modules of this package, in the order in which they measure."""


def measure_of(area: str) -> Measure:
    """What measures an area; its imports start only now."""
    found: Measure = importlib.import_module(f"{__package__}.{area}").measure
    return found
