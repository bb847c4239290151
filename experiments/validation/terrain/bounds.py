"""What the contact presets of tracks have to reach, and the checks of what was found."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from experiments.measuring.check import Check
from experiments.validation.terrain.findings import Findings


@dataclass(frozen=True)
class Bounds:
    """Largest errors, and smallest speeds, of a preset."""

    slow: float
    """Of the ICRs' half width b + D in slow turns, and of D alone, relative [-]."""
    pivot: float
    """The same in turns on the spot with +-0.5 m/s."""
    offset: float
    """The same with the centre of mass off by 30 % of half the contact's length; inf: only shown."""
    climb: float
    """Of the steepest slope that is climbed [rad]."""
    step: float
    """Of the highest step that is climbed [m]."""
    typical_depth: float
    """99th percentile of the penetration on stairs and rough ground [m]."""
    largest_depth: float
    """Largest of it [m]."""
    realtime: tuple[float, float, float]
    """Simulated time over computing time of a core, on level ground, ten steps and rough ground [-]."""
    creep: float = 0.5e-3
    """On a slope of 30 degrees [m/s]."""
    tips_sideways: float = float(np.radians(0.5))
    """Of the slope on which a robot tips over sideways [rad]."""
    tips_backwards: float = float(np.radians(3.0))
    """The same backwards, where the contact gives way at the rear [rad]."""
    fastest: float = 1.0
    """Of robots on rough ground [m/s]."""
    belts: float = 1e-12
    """Of belts on moving bodies [m/s]."""


BOUNDS = {
    "accurate": Bounds(0.01, 0.03, 0.025, float(np.radians(0.1)), 0.005, 0.004, 0.005, (40.0, 25.0, 12.0)),
    "fast": Bounds(0.015, 0.05, float("inf"), float(np.radians(0.15)), 0.006, 0.006, 0.009, (150.0, 80.0, 35.0)),
}
"""By preset."""


def checks_of(found: Findings) -> list[Check]:
    """Everything that one robot with one preset has to reach."""
    bounds, checks = BOUNDS[found.preset], []

    def check(what: str, value: float, bound: float | tuple[float, float], unit: str = "1") -> None:
        checks.append(Check(f"{found.robot}, {found.preset}", what, value, bound, unit))

    for ground, turning in (("plane", found.on_plane), ("box", found.on_box)):
        cases = (
            ("slow", turning.slow, bounds.slow),
            ("pivot at 0.5 m/s", turning.pivot, bounds.pivot),
            ("centre of mass off", turning.offset, bounds.offset),
        )
        for what, turns, bound in cases:
            if np.isfinite(bound):
                check(f"ICRs' half width b + D on a {ground}, {what}", abs(turns.worst), bound)
                check(f"D alone on a {ground}, {what}", abs(turns.outside), bound)
    for ground, angles in (("plane", found.climb_on_plane), ("box", found.climb_on_box)):
        check(f"climbing limit on a {ground}", float(np.abs([a.error for a in angles]).max()), bounds.climb, "rad")
    check("creep on 30 degrees", float(found.creep.max()), bounds.creep, "m/s")
    for number, step in enumerate(found.steps, start=1):
        check(f"highest step, case {number}", abs(step.error), bounds.step, "m")
    check("tips over sideways", abs(found.tips_sideways.error), bounds.tips_sideways, "rad")
    check("tips over backwards", abs(found.tips_backwards.error), bounds.tips_backwards, "rad")
    check("robots that don't climb the stairs", found.stairs.robots - found.stairs.arrived, 0.0)
    check("robots that don't get down the stairs", found.descent.robots - found.descent.arrived, 0.0)
    places = (("stairs", found.stairs), ("stairs down", found.descent), ("rough ground", found.rough))
    for name, sinking in places:
        check(f"penetration on {name}, 99th percentile", sinking.typical, bounds.typical_depth, "m")
        check(f"penetration on {name}, largest", sinking.largest, bounds.largest_depth, "m")
    check("warnings on stairs and rough ground", sum(sinking.warnings for _, sinking in places), 0.0)
    check("fastest robot on rough ground", found.rough.fastest, bounds.fastest, "m/s")
    speeds = (found.speed.flat, found.speed.stairs, found.speed.rough)
    for name, value, bound in zip(("level ground", "ten steps", "rough ground"), speeds, bounds.realtime, strict=True):
        check(f"times real time on {name}, one core", value, (bound, float("inf")))
    check("numbers of a batch's rows that differ from robots alone", found.differing, 0.0)
    check("sliding velocity of belts on moving bodies", found.belt_error, bounds.belts, "m/s")
    return checks
