"""Terrain for robots to cross: ramps, steps, stairs, beams, pallets, rough ground, gaps and side
slopes, in courses.

    spec = mujoco.MjSpec() course = Course((Stairs(rise=0.15, run=0.28, number=5), Flat(1.0),
    Rough(4.0, amplitude=0.1)), friction=0.8) geoms = course.add_to(spec)

`course.height(x, y)` returns heights of the surface that MuJoCo collides with.
"""

from sim.terrain.course import Course, course_names, load_course
from sim.terrain.loose import Beams, Blocks, Pallets
from sim.terrain.pieces import Flat, Gap, HeightField, Piece, Ramp, Rough, SideSlope, Stairs, Step

__all__ = [
    "Beams",
    "Blocks",
    "Course",
    "Flat",
    "Gap",
    "HeightField",
    "Pallets",
    "Piece",
    "Ramp",
    "Rough",
    "SideSlope",
    "Stairs",
    "Step",
    "course_names",
    "load_course",
]
