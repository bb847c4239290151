"""Bolt tracks and two front flippers to a box, and drive it up stairs."""

import mujoco
import numpy as np

from sim.terrain import Course, Stairs
from sim.tracks import Belts, Track, add_tracks

ROBOT = """<mujoco><worldbody><body name="robot"><freejoint/>
  <geom type="box" size=".25 .12 .05" pos=".05 0 .13" mass="25"/>
  <body name="flippers" pos=".25 0 .08"><joint name="lift" axis="0 -1 0" range="-60 60"/>
    <geom type="box" size=".12 .02 .02" pos=".12 0 0" mass="2"/></body></body></worldbody>
  <actuator><position joint="lift" kp="250" kv="15" forcerange="-90 90"/></actuator></mujoco>"""


def main(duration: float = 16.0) -> None:
    """Drive up three steps at 0.3 m/s with the flippers raised by 0.3 rad, and print position and
    slips.
    """
    spec = mujoco.MjSpec.from_string(ROBOT)
    course = Course((Stairs(rise=0.15, run=0.28, number=3),), friction=0.8)
    ground, grip = course.add_to(spec), (course.friction, course.friction)
    wheels, flipper_wheels = (
        [(-0.25, 0.08, 0.08), (0.25, 0.08, 0.08)],
        [(0.0, 0.0, 0.08), (0.25, 0.0, 0.04)],
    )
    add_tracks(spec, "robot", Track(half_gauge=0.2, hull=wheels, friction=grip), terrain=ground)
    add_tracks(
        spec, "flippers", Track(half_gauge=0.27, hull=flipper_wheels, friction=grip), terrain=ground
    )
    model = spec.compile()
    data = mujoco.MjData(model)
    data.qpos[:3], data.ctrl[0] = course.start[:3], 0.3
    belts = Belts(model)
    belts.set([0.3] * 4)
    readings = []
    while data.time < duration and data.qpos[0] < course.goal:
        mujoco.mj_step(model, data, nstep=10)
        readings.append(belts.read(data))
    x, y = data.qpos[:2]
    print(f"x = {x:.2f} m, on ground {course.height(x, y):.2f} m high, after {data.time:.1f} s")
    for name, slip in zip(
        belts.names, np.nanmean([reading.slip for reading in readings], axis=0), strict=True
    ):
        print(f"mean slip of {name}: {slip:.3f}")


if __name__ == "__main__":
    main()
