"""Robots that are let fall with belts at rest gain no energy and hardly bounce, whatever their size
and mass, and whatever arm they hold.
"""

import mujoco
import numpy as np
import pytest
from climbing_theory import SideView
from machines import LIMITS, joint, write
from machines import box as box_link
from terrain_trials import LevelGround, Robot, box, rescue
from trials import report

from experiments.common.check import Check
from sim import build_tracked, load_tracked

BOX = mujoco.mjtGeom.mjGEOM_BOX
ROUNDING, REBOUND = 1e-6, 0.25  # largest gain over the weight [m], and rebound over the drop


def random_robot(rng, terrain, preset):
    """A box with tracks of 0.2 to 6 m and a mass of 1 to 5,000 kg, with or without raised noses."""
    length, mass = np.exp(rng.uniform(np.log([0.2, 1.0]), np.log([6.0, 5000.0]))).tolist()
    half_gauge, radius = length * rng.uniform([0.2, 0.03], [0.6, 0.25])
    hull = [(-length / 2, radius, radius), (length / 2, radius, radius)]
    if rng.random() < 0.5:
        nose = radius * rng.uniform(0.4, 1.0)
        ahead, up = (
            radius + length * rng.uniform(0.05, 0.3),
            radius + length * rng.uniform(0.05, 0.25),
        )
        hull = [(-length / 2 - ahead, up, nose), *hull, (length / 2 + ahead, up, nose)]
    half_size = rng.uniform([0.3, 0.5, 0.05], [0.6, 1.2, 0.25]) * [length, half_gauge, length]
    x, z = length * rng.uniform([-0.15, 0.1], [0.15, 0.35])
    return box(terrain, preset, tuple(hull), (x, z), float(half_gauge), mass, half_size)


def robot_with_an_arm(rng, preset, folder):
    """A robot of 0.2 to 6 m and 1 to 5,000 kg with an arm of one to three joints, whose limits may
    exclude 0; arms that would reach the ground are drawn again.
    """
    length, mass = np.exp(rng.uniform(np.log([0.2, 1.0]), np.log([6.0, 5000.0]))).tolist()
    half_gauge, radius = (length * rng.uniform([0.2, 0.03], [0.6, 0.25])).tolist()
    height = 2 * radius + 0.15 * length
    parts = [box_link("base", mass, (0.8 * length, half_gauge, 0.2 * length), (0, 0, height))]
    carrier, at = "base", (0.2 * length, 0, height + 0.12 * length)
    for k in range(rng.integers(1, 4)):
        reach = length * rng.uniform(0.2, 0.6)
        own = mass * rng.uniform(0.02, 0.1)
        parts.append(
            box_link(f"arm{k}", own, (reach, 0.1 * length, 0.1 * length), (reach / 2, 0, 0))
        )
        low = rng.uniform(-1.5, 1.0)
        limits = LIMITS.format(low, low + rng.uniform(0.3, 2.0))
        axis = rng.choice(["0 1 0", "0 0 1"])
        parts.append(joint(f"j{k}", "revolute", carrier, f"arm{k}", at, axis, more=limits))
        carrier, at = f"arm{k}", (reach, 0, 0)
    hull = ((-length / 2, radius, radius), (length / 2, radius, radius))
    text = f"half_gauge = {half_gauge}\nwidth = {half_gauge / 5}\n"
    file = write(folder, parts, f"{text}hull = {[list(wheel) for wheel in hull]}\n")
    refused = []
    robot = load_tracked(file)
    built = build_tracked(robot, LevelGround(), preset=preset, refuse=refused.append)
    if refused:
        return robot_with_an_arm(rng, preset, folder)
    data = mujoco.MjData(built.model)
    mujoco.mj_forward(built.model, data)
    x, _, z = data.subtree_com[built.body]
    qpos = built.model.qpos0.copy()
    qpos[2] = -built.robot.lowest
    view = SideView(np.array(hull), (float(x), float(z)))
    return Robot(built.model, built.belts, built.track_side, qpos, np.zeros(0), half_gauge, view)


def release(robot, drop, roll=0.0, pitch=0.0):
    """Gain and rebound of a robot released with its lowest point `drop` above level ground [m,
    rad].

    Gain: its largest mechanical energy minus that at the start, the motors' work and 0.5 % of the
    drop's energy, over its weight [m]. Rebound: the height to which it rose again, over the drop.
    """
    model, data = robot.model, mujoco.MjData(robot.model)
    model.opt.enableflags |= mujoco.mjtEnableBit.mjENBL_ENERGY
    data.qpos[:], data.ctrl[:] = robot.qpos, robot.control
    mujoco.mju_euler2Quat(data.qpos[3:7], [roll, pitch, 0.0], "XYZ")
    mujoco.mj_kinematics(model, data)
    geoms = np.flatnonzero(np.isin(model.geom_bodyid, robot.belts.bodies))
    # of capsules
    reach = model.geom_size[geoms, 0] + np.abs(data.geom_xmat[geoms, 8]) * model.geom_size[geoms, 1]
    lowest = (data.geom_xpos[geoms, 2] - reach).min()
    # of the boxes of arms and of their chassis
    for shape in np.flatnonzero((model.geom_type == BOX) & (model.geom_contype > 0)):
        corner = np.abs(data.geom_xmat[shape, 6:]) @ model.geom_size[shape]
        lowest = min(lowest, data.geom_xpos[shape, 2] - corner)
    data.qpos[2] += drop - lowest
    mujoco.mj_forward(model, data)
    start, weight = data.energy.sum(), 9.81 * model.body_subtreemass[0]
    swing = np.sqrt(2 * robot.half_length / 9.81)
    steps = round((1.5 * (1 + swing) + 2 * np.sqrt(2 * drop / 9.81)) / model.opt.timestep)
    height, gained, work = np.empty(steps), np.empty(steps), 0.0
    for k in range(steps):
        before = data.qvel.copy()
        mujoco.mj_step(model, data)
        gained[k] = data.energy.sum() - start - work  # before the step
        height[k] = data.qpos[2]
        work += float(data.qfrc_actuator @ (before + data.qvel)) / 2 * model.opt.timestep
    landed = int(np.argmin(height))
    return gained.max() / weight - 0.005 * drop, (height[landed:].max() - robot.qpos[2]) / drop


def checks_of(case, make, preset, rng, count):
    """Checks of robots released from up to 0.3 of their length, once tilted by up to 35 degrees and
    once level.
    """
    gain, rebound = np.empty((2, count))
    for k in range(count):
        robot = make(rng, LevelGround(), preset)
        roll, steep = rng.uniform(-np.radians(35.0), np.radians(35.0), 2)
        pitch = rng.choice([steep, rng.normal(0.0, np.radians(3.0)), 0.0])
        high = 2 * robot.half_length * rng.uniform(0.02, 0.3)
        gain[k] = release(robot, float(rng.choice([high, 1e-3])), roll, pitch)[0]
        rebound[k] = release(robot, high)[1]
    yield Check(case, "energy gained, over the weight", max(0.0, gain.max()), ROUNDING, "m")
    yield Check(case, "rebound, over the drop", rebound.max(), REBOUND)


@pytest.mark.parametrize(
    ("preset", "count"),
    [
        ("accurate", 12),
        *(pytest.param(preset, 1000, marks=pytest.mark.slow) for preset in ("accurate", "fast")),
    ],
)
def test_random_robots(preset, count):
    report(
        f"{count} releases, {preset}",
        [*checks_of("random robots", random_robot, preset, np.random.default_rng(count), count)],
    )


@pytest.mark.parametrize(
    ("preset", "count"),
    [
        ("accurate", 12),
        *(pytest.param(preset, 200, marks=pytest.mark.slow) for preset in ("accurate", "fast")),
    ],
)
def test_robots_with_arms_gain_no_energy(preset, count, tmp_path):
    def make(rng, _, preset):
        return robot_with_an_arm(rng, preset, tmp_path)

    rng = np.random.default_rng(count)
    energy, _ = checks_of("robots with arms", make, preset, rng, count)
    report(f"{count} releases with arms, {preset}", [energy])


@pytest.mark.slow
@pytest.mark.parametrize("preset", ["accurate", "fast"])
def test_the_box_and_the_rescue_robot(preset):
    checks = []
    for make in (box, rescue):
        rng = np.random.default_rng(0)
        checks += checks_of(
            make.__name__, lambda _, *terrain, make=make: make(*terrain), preset, rng, 60
        )
    report(f"60 releases, {preset}", checks)
