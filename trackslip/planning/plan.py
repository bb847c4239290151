"""Planning of a drive within limits that determines a slip law as precisely as possible."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from trackslip.arguments import checks_arguments
from trackslip.errors import InvalidValueError, require_one_of
from trackslip.identification.path import DriveModel
from trackslip.kinematics import TRACK_SIGNS, Array, RobotGeometry, twist_of_tracks
from trackslip.laws.families import LawFamily, drive_laws, family
from trackslip.odometry.uncertainty import LawErrors
from trackslip.paper import COMMANDED_RADII, SPEEDS
from trackslip.planning.information import (
    Expectation,
    PoseQuality,
    drive_to_measure,
    expected,
    rate_of,
)
from trackslip.planning.limits import CORNER_DISTANCE, DriveLimits, Knowledge, first_knowledge
from trackslip.planning.route import RATE, PlacedRoute, Route, best_route, path, placed

PLANNED_LAWS: Final = tuple(
    name for name in drive_laws() if family(name).names and not family(name).fast
)
"""Laws for which a drive can be planned."""
PAPER_DURATION: Final = 30.0
"""Duration of each of the paper's runs [s]."""
MAX_EVALUATIONS: Final = 1000
"""Routes tried in a search."""
MIN_EVALUATIONS: Final = 200
"""Routes tried in a search for very long drives."""
_LONG_DURATION: Final = 120.0  # duration above which a search tries fewer routes [s]
# poses used in a search at most; more are replaced by fewer, more precise poses
_MAX_POSES: Final = 1200
_MIN_RATE: Final = 2.0  # fewest poses per second in a search [Hz]
_MAX_RATE: Final = 10.0  # most poses per second in a search [Hz]


@dataclass(frozen=True)
class DrivePlan(PlacedRoute):
    """A planned drive, with its purpose and the standard errors to expect."""

    law: str
    """Name of the law family for which the drive is planned."""
    values: Array  # (q,) expected parameters of the law
    limits: DriveLimits
    knowledge: Knowledge
    poses: PoseQuality
    known: LawErrors | None
    """Errors of the law from an earlier identification, if any."""
    expectation: Expectation
    """Standard errors to expect after the drive, with `known` taken into account."""

    @property
    def time(self) -> Array:
        """Start times of the command periods, and the end time, (T,) [s]."""
        return np.arange(len(self.speeds)) / RATE

    @property
    def speeds(self) -> Array:
        """Belt speeds (T, 2) [m/s] in the period from each `time`; 0 in the last row."""
        return np.concatenate([self.maneuvers.speeds(self.limits.duration), np.zeros((1, 2))])

    @property
    def omega(self) -> Array:
        """Sprocket speeds (T, 2) [rad/s] in the period from each `time`."""
        return self.speeds / self.knowledge.geometry.sprocket_radius

    @property
    def twist(self) -> Array:
        """Commands (T, 2) for a controller that assumes no slip: v [m/s], w [rad/s]."""
        return twist_of_tracks(self.speeds, self.knowledge.geometry.half_gauge)

    @property
    def path(self) -> Array:
        """Expected positions (K, 2) of the robot relative to the centre of the area [m]."""
        expected_law = self.knowledge.extremes[:1]
        x, y = path(self.maneuvers, float(self.start[2]), expected_law)
        from_start = np.stack([x[0], y[0]], axis=-1)
        return np.asarray(self.start[:2] + from_start)

    @property
    def sizes(self) -> dict[str, float]:
        """Value to which the error of each of the law's parameters is relative, in its unit."""
        return relative_to(family(self.law), self.values, self.knowledge.geometry)


@checks_arguments
def plan_drive(
    geometry: RobotGeometry,
    limits: DriveLimits,
    poses: PoseQuality,
    law: str = "icr_radius",
    knowledge: Knowledge | None = None,
    values: Sequence[float] | Array | None = None,
    known: LawErrors | None = None,
    seed: int = 0,
    step: Callable[[float], None] = lambda _: None,
) -> DrivePlan:
    """Plan the drive with the smallest largest relative standard error of a parameter of `law`.

    `law` is from PLANNED_LAWS. By default, prior `knowledge` of the robot's motion and expected
    parameters `values` (q,) are typical of hard ground. `known` are the law's errors from an
    earlier identification. `step` is called with 1.0 after each drive tried. Raises
    InvalidValueError for an unknown law, or an area or duration in which no drive determines the
    law.
    """
    require_one_of("law", law, PLANNED_LAWS)
    least = 2 * max(CORNER_DISTANCE * geometry.half_gauge, limits.clearance)
    if min(limits.area) <= least:
        allowed = f"more than {least:g} m long and wide, for the robot to turn"
        raise InvalidValueError("area", limits.area_text, allowed)
    knowledge = knowledge or first_knowledge(geometry)
    model = DriveModel(family(law), geometry)
    if values is None:
        values = usual_values(model.family, knowledge)
    expected_values = np.array(values, float)
    sizes = relative_to(model.family, expected_values, geometry)
    rate = float(np.clip(_MAX_POSES / limits.duration, _MIN_RATE, _MAX_RATE))
    quality = poses.thinned(rate)

    def expectation_of(drive: PlacedRoute, quality: PoseQuality, merge: int) -> Expectation:
        speeds = drive.maneuvers.speeds(limits.duration)
        measured = drive_to_measure(speeds, RATE, quality, geometry.sprocket_radius, merge)
        return expected(model, expected_values, [measured], quality, knowledge.slip, known)

    def cost(route: Route) -> float:
        drive = placed(route, limits, knowledge)
        step(1.0)
        if drive is None:
            return np.inf
        expectation = expectation_of(drive, quality, rate_of(quality))
        return largest(expectation, sizes)

    route, least_cost = best_route(cost, evaluations(limits), np.random.default_rng(seed))
    drive = placed(route, limits, knowledge)
    if drive is None:
        allowed = "larger, for a drive in it by any law that the robot may have"
        raise InvalidValueError("area", limits.area_text, allowed)
    if not np.isfinite(least_cost):
        allowed = f"longer, for a drive within the limits to determine the law {law}"
        raise InvalidValueError("duration", limits.duration, allowed)
    return DrivePlan(
        maneuvers=drive.maneuvers,
        start=drive.start,
        places=drive.places,
        law=law,
        values=expected_values,
        limits=limits,
        knowledge=knowledge,
        poses=poses,
        known=known,
        expectation=expectation_of(drive, poses, 1),
    )


def evaluations(limits: DriveLimits) -> int:
    """Number of drives tried in a search, which is smaller for long drives."""
    number = MAX_EVALUATIONS * _LONG_DURATION / limits.duration
    return int(np.clip(number, MIN_EVALUATIONS, MAX_EVALUATIONS))


def largest(expectation: Expectation, sizes: dict[str, float]) -> float:
    """Largest standard error relative to `sizes`; infinite if a parameter isn't determined."""
    return max(expectation.stderr.get(name, np.inf) / size for name, size in sizes.items())


def relative_to(laws: LawFamily, values: Array, geometry: RobotGeometry) -> dict[str, float]:
    """Values by which the errors of parameters are divided to become relative, by name.

    Errors in D are divided by b + D, the effective half gauge. Errors in epsilon are divided by 1,
    because belt speeds scale with 1 + epsilon, and so are errors in other dimensionless parameters.
    """
    sizes = {}
    for name, value in zip(laws.parameters, values.tolist(), strict=True):
        is_length = laws.parameters[name].unit == "m"
        sizes[name] = geometry.half_gauge + value if is_length else 1.0
    return sizes


def usual_values(laws: LawFamily, knowledge: Knowledge) -> Array:
    """Typical parameters (q,) of a law for a robot about which only `knowledge` is available."""
    values = laws.starts(knowledge.geometry.half_gauge)[0]
    for place, name in enumerate(laws.names):
        if name.startswith("offset"):
            values[place] = knowledge.offset
        if name.startswith("radius_error"):
            values[place] = knowledge.radius_error
    return values


def paper_runs(geometry: RobotGeometry) -> list[Array]:
    """Belt speeds (2,) [m/s] in those of the paper's 25 runs whose radius suits the robot."""
    radii = [radius for radius in COMMANDED_RADII if radius > geometry.half_gauge]
    return [
        v * (1 + TRACK_SIGNS * geometry.half_gauge / radius) for radius in radii for v in SPEEDS
    ]


def expected_of_paper(plan: DrivePlan) -> Expectation | None:
    """Errors to expect from the paper's runs; None if the runs don't determine the law.

    None also for a robot so large that it can't drive any of the runs.
    """
    geometry = plan.knowledge.geometry
    radius = geometry.sprocket_radius
    merge = rate_of(plan.poses)
    periods = round(PAPER_DURATION * RATE)
    runs = [np.tile(speeds, (periods, 1)) for speeds in paper_runs(geometry)]
    drives = [drive_to_measure(speeds, RATE, plan.poses, radius, merge) for speeds in runs]
    if not drives:
        return None
    model = DriveModel(family(plan.law), geometry)
    found = expected(model, plan.values, drives, plan.poses, plan.knowledge.slip)
    is_determined = all(name in found.stderr for name in model.family.names)
    return found if is_determined else None
