"""The areas of `trackslip bench --pipeline`: each module of this package measures one of them against its bounds."""

import importlib
from collections.abc import Callable
from importlib.util import find_spec

from experiments.measuring.check import Check

Measure = Callable[[int, int, Callable[[str], None]], tuple[Check, ...]]
"""What each module calls `measure`: from seed, number of rounds, and what to call with a label after each round."""

ORDER = (
    "physics",
    "environments",
    "closed_loop",
    "localization",
    "laws",
    "report",
    "reproduce",
    "scale",
)
"""Modules of this package, in the order in which they measure."""
AREAS = tuple(name for name in ORDER if find_spec(f"{__package__}.{name}"))


def measure_of(area: str) -> Measure:
    """What measures an area; its imports start only now."""
    found: Measure = importlib.import_module(f"{__package__}.{area}").measure
    return found
