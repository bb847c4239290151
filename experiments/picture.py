"""Picture of the field: the robot at the start of the paper's path, before the laser range finder.

Run as `python -m experiments.picture --out models/field.png`.
"""

from __future__ import annotations

import argparse
import os
import sys
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING

import matplotlib.image
import numpy as np
from numpy.typing import NDArray

from trackslip.errors import TrackslipError
from trackslip.trajectory.segmented import paper_reference

if TYPE_CHECKING:
    import mujoco

PATH_COLOUR = (0.93, 0.16, 0.42, 1.0)
HIT_COLOUR = (0.95, 0.10, 0.10, 0.55)
MISS_COLOUR = (0.95, 0.25, 0.20, 0.10)

Points = NDArray[np.float64]


def paper_path(spacing: float = 0.02) -> Points:
    """The paper's reference path as points (N, 2) on the ground [m], about `spacing` [m] apart."""
    reference = paper_reference()
    dense = reference.pose(np.linspace(0.0, reference.duration, 5000))[:, :2]
    along = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(dense, axis=0).T))])
    even = np.linspace(0.0, along[-1], round(along[-1] / spacing) + 1)
    return np.column_stack([np.interp(even, along, dense[:, 0]), np.interp(even, along, dense[:, 1])])


def render(
    path_points: Points,
    camera: str = "overview",
    width: int = 1280,
    height: int = 680,
    beams: bool = True,
) -> NDArray[np.uint8]:
    """Renders the field with the robot at rest at the start of a path.

    Args:
        path_points: (N, 2), world x and y [m]; the robot stands on the first and looks towards the second.
        camera: a camera of field.xml: overview, robot or top.
        width: pixels.
        height: pixels.
        beams: whether the range finder's beams are drawn.

    Returns:
        Image (height, width, 3), RGB.

    Raises:
        TrackslipError: OpenGL does not work here; MUJOCO_GL chooses the backend (egl, osmesa or glfw).
    """
    try:
        import mujoco  # late, because MUJOCO_GL counts at import

        from sim.robot.robot import FIELD
    except (ImportError, AttributeError) as error:
        raise TrackslipError(f"MuJoCo's OpenGL does not load: {error}") from error

    model = mujoco.MjModel.from_xml_path(str(FIELD))
    data = mujoco.MjData(model)
    step = path_points[1] - path_points[0]
    half_heading = 0.5 * np.arctan2(step[1], step[0])
    data.qpos[:] = [*path_points[0], 0.0, np.cos(half_heading), 0.0, 0.0, np.sin(half_heading)]
    mujoco.mj_step(model, data, nstep=200)  # 1 s: the pads sink into the ground by their 2 mm

    try:
        renderer = mujoco.Renderer(model, height, width)
    except (mujoco.FatalError, AttributeError, ImportError) as error:
        raise TrackslipError(f"OpenGL does not start: {error}") from error
    with renderer:
        renderer.update_scene(data, camera=camera)
        _draw_path(renderer.scene, path_points)
        if beams:
            _draw_beams(renderer.scene, model, data)
        image: NDArray[np.uint8] = renderer.render()
    return image


def _draw_path(scene: mujoco.MjvScene, path_points: Points, width: float = 0.04) -> None:
    """Paints a path (N, 2) on the ground as a ribbon of the given width [m]."""
    import mujoco

    for start, end in pairwise(path_points):
        along = (end - start) / np.linalg.norm(end - start)
        rotation = np.array([[along[0], -along[1], 0.0], [along[1], along[0], 0.0], [0.0, 0.0, 1.0]])
        size = np.array([0.5 * np.linalg.norm(end - start), 0.5 * width, 0.001])
        position = np.append(0.5 * (start + end), 0.002)
        _add(scene, mujoco.mjtGeom.mjGEOM_BOX, size, position, rotation, PATH_COLOUR)


def _draw_beams(scene: mujoco.MjvScene, model: mujoco.MjModel, data: mujoco.MjData) -> None:
    """Draws beams from the site `lrf`: those that meet the plate (group 0), and some others faintly."""
    import mujoco

    origin = data.site("lrf").xpos
    angle = np.radians(np.arange(-90.0, 90.5, 1.0))
    local = np.stack([np.cos(angle), np.sin(angle), np.zeros_like(angle)], axis=-1)
    direction = local @ data.site("lrf").xmat.reshape(3, 3).T
    seen = np.array([1, 0, 0, 0, 0, 0], dtype=np.uint8)
    for k, ray in enumerate(direction):
        distance = mujoco.mj_ray(model, data, origin, ray, seen, 1, -1, np.zeros(1, dtype=np.int32))
        if distance >= 0.0:
            spot = origin + distance * ray
            _line(scene, origin, spot, HIT_COLOUR)
            _add(scene, mujoco.mjtGeom.mjGEOM_SPHERE, np.full(3, 0.009), spot, np.eye(3), HIT_COLOUR)
        elif k % 10 == 0:
            _line(scene, origin, origin + 1.5 * ray, MISS_COLOUR)


def _line(scene: mujoco.MjvScene, start: Points, end: Points, rgba: tuple[float, ...]) -> None:
    """Adds a line between two points (3,) [m], two pixels wide. Unlike rods, lines throw no shadows."""
    import mujoco

    kind = mujoco.mjtGeom.mjGEOM_LINE
    geom = _add(scene, kind, np.ones(3), start, np.eye(3), rgba)
    mujoco.mjv_connector(geom, kind, 2.0, start, end)


def _add(
    scene: mujoco.MjvScene,
    kind: mujoco.mjtGeom,
    size: Points,
    position: Points,
    rotation: Points,
    rgba: tuple[float, ...],
) -> mujoco.MjvGeom:
    """Appends a decorative geom to the scene: size (3,) and position (3,) [m], rotation (3, 3)."""
    import mujoco

    if scene.ngeom >= scene.maxgeom:
        raise TrackslipError(f"the scene holds {scene.maxgeom} geoms; draw the path with fewer points")
    geom = scene.geoms[scene.ngeom]
    mujoco.mjv_initGeom(geom, kind, size, position, rotation.ravel(), np.array(rgba, dtype=np.float32))
    geom.emission, geom.specular = 0.4, 0.0
    scene.ngeom += 1
    return geom


def main() -> int:
    """Writes the picture; returns the exit status."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, default=Path("models/field.png"), help="PNG file to write")
    parser.add_argument("--camera", default="overview", choices=["overview", "robot", "top"])
    arguments = parser.parse_args()
    if not os.environ.get("DISPLAY"):
        os.environ.setdefault("MUJOCO_GL", "egl")
    try:
        image = render(paper_path(), camera=arguments.camera)
        matplotlib.image.imsave(arguments.out, image)
    except TrackslipError as error:
        backend = os.environ.get("MUJOCO_GL", "unset")
        print(f"picture: {error} (MUJOCO_GL is {backend}; egl, osmesa and glfw exist)", file=sys.stderr)
        return 2
    except OSError as error:
        print(f"picture: cannot write {arguments.out}: {error.strerror}", file=sys.stderr)
        return 2
    print(f"wrote {arguments.out}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
