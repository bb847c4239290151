"""The belt's way around the wheels of a hull: straight runs, and arcs on the wheels."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Outline:
    """A closed belt around wheels, in the x-z plane of its body, run through as under a robot that drives backwards.

    It leaves the first wheel along the lower run, forwards, and returns above. Pieces are runs and arcs in turn.
    """

    wheels: Array  # (W, 3) x, z and radius, counter-clockwise seen from the right [m]
    leave: Array  # (W, 2) where the belt leaves each wheel [m]
    run: Array  # (W,) length of the straight run that follows each wheel [m]
    heading: Array  # (W,) its direction, from x towards z, unwrapped [rad]
    wrap: Array  # (W,) angle that the belt lies on each wheel, before it leaves it [rad]

    @classmethod
    def of(cls, hull: Array) -> Outline:
        """The belt around the wheels (W, 3) of a convex hull, in either order."""
        wheels = np.asarray(hull, float)
        x, z = wheels[:, 0], wheels[:, 1]
        if np.sum(x * np.roll(z, -1) - np.roll(x, -1) * z) < 0:
            wheels = wheels[::-1]
        if len(wheels) == 2:
            wheels = wheels[np.argsort(wheels[:, 0])]
        after = np.roll(wheels, -1, axis=0)
        way = after[:, :2] - wheels[:, :2]
        distance = np.hypot(*way.T)
        toe = np.arcsin((wheels[:, 2] - after[:, 2]) / distance)  # of the tangent to the line of centres
        heading = np.arctan2(way[:, 1], way[:, 0]) + toe
        wrap = np.mod(heading - np.roll(heading, 1), 2 * np.pi)
        heading = heading[0] + np.append(0.0, np.cumsum(wrap[1:]))
        outwards = np.stack([np.sin(heading), -np.cos(heading)], axis=-1)
        leave = wheels[:, :2] + wheels[:, 2:] * outwards
        return cls(wheels, leave, distance * np.cos(toe), heading, wrap)

    @property
    def length(self) -> float:
        """Length of the belt [m]."""
        return float(self.run.sum() + (self.wrap * self.wheels[:, 2]).sum())

    def place(self, distance: Array) -> tuple[Array, Array]:
        """Points (..., 2) [m] and directions (...) [rad] at distances (...) along the belt [m]."""
        ends = np.cumsum(np.stack([self.run, np.roll(self.wrap * self.wheels[:, 2], -1)], axis=1).ravel())
        s = np.mod(distance, ends[-1])
        piece = np.minimum(np.searchsorted(ends, s, side="right"), len(ends) - 1)
        s = s - np.append(0.0, ends)[piece]
        wheel = piece // 2
        onto = (wheel + 1) % len(self.run)  # the wheel of the arc after that run
        arc = piece % 2 == 1
        radius = self.wheels[onto, 2]
        heading = self.heading[wheel] + np.where(arc, s / radius, 0.0)
        ahead, outwards = np.cos(heading), np.sin(heading)
        straight = self.leave[wheel] + s[..., None] * np.stack([ahead, outwards], axis=-1)
        round_ = self.wheels[onto, :2] + radius[..., None] * np.stack([outwards, -ahead], axis=-1)
        return np.where(arc[..., None], round_, straight), heading
