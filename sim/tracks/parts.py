"""The geoms of a track: capsules along the runs of the belt, spheres at its wheels."""

from __future__ import annotations

from dataclasses import dataclass

import mujoco
import numpy as np

from sim.tracks.hull import Hull
from sim.tracks.presets import Preset

_MAX_RUN_RADIUS = 0.03  # [m]
_ALONG = (0.0, 0.0, 1.0, 0.0, 0.0, 0.0)


@dataclass(frozen=True)
class TrackParts:
    """The tracks of one call of `add_tracks`: each a body without joints, with its geoms and a contact sensor."""

    names: tuple[str, ...]
    """Name of each track: of its body, and where the names of its geoms and of its sensor begin."""
    hull: Hull
    """The hull of each track."""
    offsets: tuple[float, ...]
    """Position of each track to the left on the body [m]."""
    preset: Preset
    """The contact recipe."""
    friction: tuple[float, float]
    """Friction coefficients along and across the belt [-]."""
    load: float
    """Part of the robot's weight that these tracks carry when it stands on them [-]."""
    geoms: tuple[tuple[str, ...], ...]
    """Names of the geoms of each track."""
    weights: tuple[float, ...]
    """Stiffness of each geom of a track, relative to that of a capsule's end [-]."""
    directions: tuple[tuple[float, ...], ...]
    """Surface velocity (6,) of each geom of a track in its own frame, at a belt speed of 1 m/s."""
    points: int
    """Number of points with which these tracks stand on their longest runs."""


@dataclass(frozen=True)
class Part:
    """A geom of a track."""

    name: str
    """Its name, after that of the track."""
    shape: dict[str, object]
    """Type, place and size, in the track's frame; the own z axis of a capsule along the run is the belt's direction."""
    weight: float
    """Stiffness relative to that of a capsule's end [-]."""
    direction: tuple[float, ...]
    """Surface velocity (6,) in its own frame, at a belt speed of 1 m/s."""


def track_parts(hull: Hull, segments: int, anisotropic: bool) -> list[Part]:
    """Geoms of a track, in its frame."""
    longest = max(run.length for run in hull.runs)
    parts = []
    for i, run in enumerate(hull.runs):
        count = max(2, 2 * round(segments * run.length / longest / 2))
        # with two wheels at its ends, a chain shorter by one segment has the mean distance of an even load
        chain = run.length * (1 - 1 / count)
        radius = min(run.radius, _MAX_RUN_RADIUS)
        middle = (run.start + run.end) / 2 - radius * run.outwards
        turn = np.arctan2(run.along[0], run.along[1])  # about y, from z to the belt's direction
        for j in range(count):
            x, z = middle + ((j + 0.5) / count - 0.5) * chain * run.along
            shape = {
                "type": mujoco.mjtGeom.mjGEOM_CAPSULE,
                "pos": [x, 0.0, z],
                "size": [radius, chain / count / 2, 0.0],
                "quat": [np.cos(turn / 2), 0.0, np.sin(turn / 2), 0.0],
            }
            parts.append(Part(f"run{i}_{j}", shape, 1.0, _ALONG))
    for i, (x, z, radius) in enumerate(hull.wheels.tolist()):
        parts.append(_wheel(i, x, z, radius, anisotropic))
    return parts


def _wheel(index: int, x: float, z: float, radius: float, anisotropic: bool) -> Part:
    if not anisotropic:
        sphere = {"type": mujoco.mjtGeom.mjGEOM_SPHERE, "pos": [x, 0.0, z], "size": [radius, 0.0, 0.0]}
        return Part(f"wheel{index}", sphere, 1.0, (0.0, 0.0, 0.0, 0.0, 1 / radius, 0.0))
    # on a plane only a capsule's contact frame turns with the robot; it touches at both ends, each with half the load
    across = {
        "type": mujoco.mjtGeom.mjGEOM_CAPSULE,
        "pos": [x, 0.0, z],
        "size": [radius, radius / 100, 0.0],
        "quat": [np.sqrt(0.5), np.sqrt(0.5), 0.0, 0.0],
    }
    return Part(f"wheel{index}", across, 0.5, (0.0, 0.0, 0.0, 0.0, 0.0, -1 / radius))
