"""Write the two meshes of a track, `track_belt.obj` and `track_wheels.obj`: `python -m models.make_meshes`.

A belt has 44 shoes. If each were a geom, moving them would take more than a tenth of every physics step; a mesh is a
single geom. All lengths are in metres, in the frame of a track: x forward, y left, z up, origin on the ground under the
centre of the track. The meshes have no contacts.
"""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

HALF_WHEELBASE = 0.20  # sprocket and idler are at x = -+ this, as in tracked_robot.xml
AXLE_HEIGHT = 0.07
BELT_INSIDE, BELT_OUTSIDE, SHOE_OUTSIDE = 0.060, 0.065, 0.070  # radii on the wheels: 0.060 is the sprocket's
BELT_HALF_WIDTH = 0.045
SHOES, SHOE_LENGTH = 44, 0.014

Points = NDArray[np.float64]


class Mesh:
    """Convex polygons without shared vertices, so that every face is flat-shaded."""

    def __init__(self) -> None:
        """Start without polygons."""
        self.polygons: list[Points] = []  # each (N, 3), counter-clockwise seen from outside [m]

    def prism(self, section: Points, right: float, left: float) -> None:
        """Extrude a convex section (N, 2) in (x, z), counter-clockwise from the right, from y = right to y = left."""
        near, far = np.insert(section, 1, right, axis=-1), np.insert(section, 1, left, axis=-1)
        after = [*range(1, len(section)), 0]
        sides = np.stack([near[after], near, far, far[after]], axis=1)  # (N, 4, 3)
        self.polygons += [near, far[::-1], *sides]

    def disc(self, x: float, z: float, radius: float, right: float, left: float, sides: int = 30) -> None:
        """Add a wheel with its axle along y at (x, z), from y = right to y = left."""
        angle = np.linspace(0.0, 2.0 * np.pi, sides, endpoint=False)
        rim = np.stack([x + radius * np.cos(angle), z + radius * np.sin(angle)], axis=-1)
        self.prism(rim, right, left)

    def box(self, low: tuple[float, float, float], high: tuple[float, float, float]) -> None:
        """Add an axis-aligned box between two opposite corners."""
        section = np.array([[low[0], low[2]], [high[0], low[2]], [high[0], high[2]], [low[0], high[2]]])
        self.prism(section, low[1], high[1])

    def write(self, path: Path, title: str) -> None:
        """Write a Wavefront OBJ file."""
        vertices, faces, count = [], [], 0
        for polygon in self.polygons:
            vertices += ["v " + " ".join(f"{c:.5g}" for c in corner) for corner in polygon.round(5) + 0.0]
            faces += [f"f {count + 1} {count + k + 1} {count + k + 2}" for k in range(1, len(polygon) - 1)]
            count += len(polygon)
        lines = [f"# {title}; written by make_meshes.py", *vertices, *faces]
        path.write_text("\n".join(lines) + "\n", encoding="utf-8")


def along_loop(distance: Points) -> tuple[Points, Points]:
    """Points (N, 2) in (x, z) on the outside of the belt, and outward normals (N, 2), at distances (N,) along it.

    The loop starts under the sprocket and runs forward along the ground.
    """
    straight, arc = 2.0 * HALF_WHEELBASE, np.pi * BELT_OUTSIDE
    s = np.mod(distance, 2.0 * (straight + arc))
    second = s >= straight + arc  # the upper run and the sprocket's arc are the first half turned by pi
    s = np.where(second, s - straight - arc, s)
    turn = np.clip(s - straight, 0.0, arc) / BELT_OUTSIDE
    normal = np.stack([np.sin(turn), -np.cos(turn)], axis=-1)
    centre = np.stack([np.minimum(s, straight) - HALF_WHEELBASE, np.zeros_like(s)], axis=-1)
    point = centre + BELT_OUTSIDE * normal
    sign = np.where(second, -1.0, 1.0)[:, None]
    return sign * point + [0.0, AXLE_HEIGHT], sign * normal


def belt() -> Mesh:
    """The rubber belt with its shoes."""
    mesh = Mesh()
    length = 4.0 * HALF_WHEELBASE + 2.0 * np.pi * BELT_OUTSIDE

    straight, arc = 2.0 * HALF_WHEELBASE, np.pi * BELT_OUTSIDE
    half = np.concatenate([[0.0], straight + np.linspace(0.0, arc, 17)[:-1]])
    s = np.concatenate([half, half + straight + arc, [length]])
    point, normal = along_loop(s)
    inner = point - (BELT_OUTSIDE - BELT_INSIDE) * normal
    for k in range(len(s) - 1):
        section = np.array([point[k], point[k + 1], inner[k + 1], inner[k]])
        mesh.prism(section, -BELT_HALF_WIDTH, BELT_HALF_WIDTH)

    middle = (np.arange(SHOES) + 0.5) * length / SHOES
    point, normal = along_loop(middle)
    tangent = np.stack([-normal[:, 1], normal[:, 0]], axis=-1)
    for p, n, t in zip(point, normal, tangent, strict=True):
        root, tip = 0.5 * SHOE_LENGTH * t, 0.35 * SHOE_LENGTH * t
        crest, base = p + (SHOE_OUTSIDE - BELT_OUTSIDE) * n, p - 0.001 * n
        section = np.array([crest - tip, crest + tip, base + root, base - root])
        mesh.prism(section, -BELT_HALF_WIDTH, BELT_HALF_WIDTH)
    return mesh


def wheels() -> Mesh:
    """Idler, road wheels, return rollers, hubs, bolts and the beam that carries them, without the sprocket."""
    mesh = Mesh()
    mesh.disc(HALF_WHEELBASE, AXLE_HEIGHT, BELT_INSIDE, -0.034, -0.008)
    mesh.disc(HALF_WHEELBASE, AXLE_HEIGHT, BELT_INSIDE, 0.008, 0.034)
    for x in (-HALF_WHEELBASE, HALF_WHEELBASE):
        mesh.disc(x, AXLE_HEIGHT, 0.020, -0.042, 0.042, sides=24)
        for angle in np.arange(6) * np.pi / 3.0:
            bolt = x + 0.040 * np.cos(angle), AXLE_HEIGHT + 0.040 * np.sin(angle)
            mesh.disc(*bolt, 0.007, -0.038, 0.038, sides=12)
    for x in (-0.105, -0.035, 0.035, 0.105):
        floor = AXLE_HEIGHT - BELT_INSIDE
        mesh.disc(x, floor + 0.030, 0.030, -0.034, 0.034)
        mesh.disc(x, floor + 0.030, 0.011, -0.040, 0.040, sides=16)
    for x in (-0.07, 0.07):
        mesh.disc(x, AXLE_HEIGHT + BELT_INSIDE - 0.012, 0.012, -0.030, 0.030, sides=20)
    mesh.box((-0.19, -0.012, 0.074), (0.19, 0.012, 0.094))
    return mesh


def main() -> None:
    """Write both meshes next to this file."""
    folder = Path(__file__).parent
    belt().write(folder / "track_belt.obj", "belt and shoes of one track")
    wheels().write(folder / "track_wheels.obj", "idler, road wheels and hubs of one track")


if __name__ == "__main__":
    main()
