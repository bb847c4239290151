"""Courses: the surface that they say is the one that MuJoCo has."""

import mujoco
import numpy as np
import pytest

from sim.terrain import Beams, Course, Flat, Gap, Pallets, Ramp, Rough, SideSlope, Stairs, Step

PIECES = {
    "flat": (Flat(2.0),),
    "ramps": (Ramp(0.4, 2.0), Flat(1.0), Ramp(-0.3, 1.5)),
    "steps": (Step(0.1), Step(-0.25)),
    "stairs": (Stairs(0.15, 0.28, 6), Flat(0.5), Stairs(-0.18, 0.3, 4, width=1.2)),
    "beams": (Beams(yaw=0.4), Beams(0.05, 0.3, 4)),
    "pallets": (Pallets(yaw=0.3),),
    "rough": (Rough(), Step(0.2), Rough(2.0, 0.05, cell=0.07, blend=0.0)),
    "gap": (Gap(0.3, 0.4), Flat(0.5), Gap(0.2)),
    "side_slope": (SideSlope(0.4), SideSlope(-0.3, blend=0.3)),
    "between_slopes": (Ramp(0.3, 1.0), Ramp(0.5, 1.0), Ramp(-0.2, 1.0), Rough(), Ramp(0.2), Gap(), Ramp(-0.4)),
}


def compiled(course, **options):
    spec = mujoco.MjSpec()
    course.add_to(spec, **options)
    model = spec.compile()
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    return model, data


def look_down(model, data, points):
    """Heights (P,) and normals (P, 3) of what rays hit that look down at `points` (P, 2)."""
    heights, normals = np.empty(len(points)), np.empty((len(points), 3))
    down, geom = np.array([0.0, 0.0, -1.0]), np.zeros(1, np.int32)
    for k, (x, y) in enumerate(points):
        heights[k] = 30.0 - mujoco.mj_ray(model, data, np.array([x, y, 30.0]), down, None, 1, -1, geom, normals[k])
    return heights, normals


@pytest.mark.parametrize("pieces", PIECES.values(), ids=PIECES)
def test_height_and_normal_are_those_that_rays_find(pieces):
    course = Course(pieces, width=2.5, seed=3)
    low, high = course.bounds[:, :2]
    points = np.random.default_rng(0).uniform(low - 0.3, high + 0.3, (3000, 2))
    height, normal = look_down(*compiled(course), points)
    assert np.abs(course.height(*points.T) - height).max() < 1e-6
    beside = np.abs(course.normal(*points.T) - normal).max(axis=1)
    assert (beside < 1e-6).all()
