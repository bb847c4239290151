"""The paths of runs: by name, or from waypoint files with limits on the motion."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from experiments.common.lookup import reference
from experiments.common.plain_json import plain
from trackslip.trajectory.base import Reference
from trackslip.trajectory.named import one_circle
from trackslip.trajectory.path import LIMITS, MotionLimits
from trackslip.trajectory.waypoints import TOLERANCE


@dataclass(frozen=True)
class PathPlan:
    """How waypoint files become paths; named paths don't depend on it."""

    limits: MotionLimits
    """Limits on the motion."""
    tolerance: float
    """Distance by which a path may miss its points [m]."""

    def path(self, name: str) -> Reference:
        """A path by name or from a file."""
        if not is_file(name):
            return reference(name)
        return reference(name, self.limits, self.tolerance)

    def metadata(self, name: str) -> dict[str, Any]:
        """Entries of a run's metadata from which `path_of` makes its path again."""
        entries: dict[str, Any] = {"reference": name}
        if is_file(name):
            entries["waypoints"] = plain(self)
        return entries


def path_of(metadata: Mapping[str, Any]) -> Reference:
    """The path of a run, from its metadata."""
    circle = metadata.get("circle")
    if circle:
        return one_circle(**circle)
    name = str(metadata.get("reference"))
    waypoints = metadata.get("waypoints")
    if not waypoints:
        return reference(name)
    return PathPlan(MotionLimits(**waypoints["limits"]), waypoints["tolerance"]).path(name)


PLAN: Final = PathPlan(LIMITS, TOLERANCE)
"""The plan for the shipped robot."""


def is_file(name: str) -> bool:
    """Whether the name of a path is that of a waypoint file."""
    return Path(name).suffix.lower() == ".csv"
