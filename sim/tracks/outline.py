"""The belt's way around a hull: straight runs, and arcs on the wheels."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sim.tracks.hull import Hull

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Outline:
    """A closed belt in the x-z plane of its body, in the direction in which it runs when the robot drives forwards."""

    wheels: Array  # (W, 3) x, z and radius [m]
    start: Array  # (W, 2) where the belt leaves each wheel [m]
    run: Array  # (W,) length of the straight run that follows [m]
    heading: Array  # (W,) direction of that run, from x towards z [rad]
    arc: Array  # (W,) length of the arc on the next wheel, which follows the run [m]

    @classmethod
    def of(cls, hull: Hull) -> Outline:
        """The belt around a hull."""
        heading = np.array([np.arctan2(*run.along[::-1]) for run in hull.runs])
        bend = np.mod(heading - np.roll(heading, -1), 2 * np.pi)  # clockwise, on the next wheel
        start = np.array([run.start for run in hull.runs])
        length = np.array([run.length for run in hull.runs])
        return cls(hull.wheels, start, length, heading, bend * np.roll(hull.wheels[:, 2], -1))

    @property
    def ends(self) -> Array:
        """(2 W,) where each run and the arc after it end, along the belt [m]."""
        return np.cumsum(np.stack([self.run, self.arc], axis=1).ravel())

    def place(self, distance: Array) -> tuple[Array, Array]:
        """Points (..., 2) [m] and directions (...) [rad] at distances (...) along the belt [m]."""
        ends = self.ends
        s = np.mod(distance, ends[-1])
        piece = np.minimum(np.searchsorted(ends, s, side="right"), len(ends) - 1)
        s = s - np.append(0.0, ends)[piece]
        wheel, on_wheel = piece // 2, piece % 2 == 1
        x, z, radius = self.wheels[(wheel + 1) % len(self.wheels)].T
        heading = self.heading[wheel] - np.where(on_wheel, s / radius.T, 0.0)
        ahead, up = np.cos(heading), np.sin(heading)
        straight = self.start[wheel] + s[..., None] * np.stack([ahead, up], axis=-1)
        bent = np.stack([x.T - radius.T * up, z.T + radius.T * ahead], axis=-1)
        return np.where(on_wheel[..., None], bent, straight), heading
