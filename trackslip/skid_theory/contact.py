"""Contact of two tracks, or wheels, with the ground, and the loads that they carry."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from trackslip.errors import InvalidValueError, require, require_finite, require_non_negative, require_positive
from trackslip.kinematics import Array


@dataclass(frozen=True)
class Load:
    """A slope and a drawbar pull, which add to the weight of a robot on level ground."""

    slope: float = 0.0
    """Angle of the ground to the horizontal [rad]."""
    uphill: float = 0.0
    """Direction of uphill in the robot's frame: 0 straight ahead, positive to the left [rad]."""
    pull: float = 0.0
    """Drawbar force, backwards along the robot, over the robot's weight [-]."""
    hitch_height: float = 0.0
    """Height of the drawbar above the ground [m]."""

    def __post_init__(self) -> None:
        require_non_negative("slope", self.slope)
        require(self.slope < math.pi / 2, "slope", self.slope, "less than pi / 2")
        for name in ("uphill", "pull", "hitch_height"):
            require_finite(name, getattr(self, name))

    @property
    def downhill(self) -> Array:
        """Force of the slope (2,) along and across the robot that the ground balances, over the normal force [-]."""
        return math.tan(self.slope) * np.array([math.cos(self.uphill), math.sin(self.uphill)])

    @property
    def drawbar(self) -> float:
        """The pull over the normal force [-]."""
        return self.pull / math.cos(self.slope)


@dataclass(frozen=True)
class Contact:
    """Contact points of the tracks, their friction, and the centre of mass."""

    x: Array  # (K,) along the robot [m]
    y: Array  # (K,) to its left [m]; points with y > 0 are on the left track
    along: float
    """Friction coefficient along the track [-]."""
    across: float
    """Friction coefficient across the track [-]."""
    centre_of_mass: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """Distance ahead and to the left of the middle between the tracks, and height above the ground [m]."""
    patch: tuple[Array, Array] | None = None
    """Rear and front ends (K,) of the patch in which each point touches the ground; None for one patch a track [m]."""

    def __post_init__(self) -> None:
        require_positive("along", self.along)
        require_positive("across", self.across)
        if not (self.x.shape == self.y.shape and self.x.ndim == 1 and self.x.size > 0):
            raise InvalidValueError("x, y", (self.x.shape, self.y.shape), "two equal (K,)")
        require(np.isfinite(self.centre_of_mass).all(), "centre_of_mass", self.centre_of_mass, "finite")
        if self.loads(np.zeros(2)).min() < 0:
            raise InvalidValueError(
                "centre_of_mass", self.centre_of_mass, "close enough to the middle to load every point of the tracks"
            )

    @property
    def ends(self) -> tuple[Array | float, Array | float]:
        """Rear and front ends of the patches, those of tracks half a space beyond their outermost points [m]."""
        if self.patch is not None:
            return self.patch
        x = np.unique(self.x)
        half_space = (x[-1] - x[0]) / max(len(x) - 1, 1) / 2
        return float(x[0] - half_space), float(x[-1] + half_space)

    def loads(self, acceleration: Array, drawbar_moment: float = 0.0) -> Array:
        """Fractions (..., K) of the weight on each point, at accelerations (..., 2) of the centre of mass along and
        across the robot, in units of gravity, and under the moment of a drawbar over the weight [m].

        A rigid robot on equal springs: the load is linear in position and balances the moments of weight and inertia.
        """
        forwards, left, height = self.centre_of_mass
        middle_x, middle_y = forwards - height * acceleration[..., :1], left - height * acceleration[..., 1:]
        middle_x = middle_x - drawbar_moment
        spread = 1 + middle_x * self.x / np.mean(self.x**2) + middle_y * self.y / np.mean(self.y**2)
        return spread / self.x.size


def line_contact(
    half_gauge: float,
    half_length: float,
    along: float,
    across: float,
    centre_of_mass: tuple[float, float, float] = (0.0, 0.0, 0.0),
    points: int = 200,
) -> Contact:
    """Two tracks with uniform pressure on the ground, apart from the effect of the centre of mass.

    Lengths are in m; `along` and `across` are friction coefficients, and `points` per track lie in the middle of equal
    segments. Raises InvalidValueError if a value is not positive, or the centre of mass lifts part of a track.
    """
    require_positive("half_length", half_length)
    return wheel_contact(half_gauge, (0.0,), 2 * half_length, along, across, centre_of_mass, points)


def wheel_contact(
    half_gauge: float,
    axles: Sequence[float],
    patch_length: float,
    along: float,
    across: float,
    centre_of_mass: tuple[float, float, float] = (0.0, 0.0, 0.0),
    points: int = 20,
) -> Contact:
    """Wheels on patches with uniform pressure, one on either side of each axle; else as `line_contact`.

    `axles` are their distances ahead of the middle of all, whose mean is 0 [m]; `points` are those per patch.
    """
    require_positive("half_gauge", half_gauge)
    require_positive("patch_length", patch_length)
    segment = (np.arange(points) + 0.5) / points - 0.5
    middle = np.repeat(np.tile(axles, 2), points)
    x = middle + patch_length * np.tile(segment, 2 * len(axles))
    y = np.repeat([half_gauge, -half_gauge], points * len(axles))
    return Contact(x, y, along, across, centre_of_mass, (middle - patch_length / 2, middle + patch_length / 2))
