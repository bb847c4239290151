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
ROUNDING = 1e-6  # largest gain of energy, over the weight [m]
REBOUND = 0.25  # largest rebound, over the drop
G = 9.81  # [m/s^2]


def random_size(rng):
    """Length from 0.2 to 6 m and mass from 1 to 5,000 kg, even in their logarithms, half gauge and
    radius of the wheels.
    """
    low = np.log([0.2, 1.0])
    high = np.log([6.0, 5000.0])
    length, mass = np.exp(rng.uniform(low, high)).tolist()
    half_gauge, radius = (length * rng.uniform([0.2, 0.03], [0.6, 0.25])).tolist()
    return length, mass, half_gauge, radius


def random_robot(rng, terrain, preset):
    """A box with tracks of 0.2 to 6 m and a mass of 1 to 5,000 kg, with or without raised noses."""
    length, mass, half_gauge, radius = random_size(rng)
    hull = [(-length / 2, radius, radius), (length / 2, radius, radius)]
    if rng.random() < 0.5:
        nose = radius * rng.uniform(0.4, 1.0)
        ahead = radius + length * rng.uniform(0.05, 0.3)
        up = radius + length * rng.uniform(0.05, 0.25)
        hull = [(-length / 2 - ahead, up, nose), *hull, (length / 2 + ahead, up, nose)]
    proportions = rng.uniform([0.3, 0.5, 0.05], [0.6, 1.2, 0.25])
    half_size = proportions * [length, half_gauge, length]
    x, z = length * rng.uniform([-0.15, 0.1], [0.15, 0.35])
    return box(terrain, preset, tuple(hull), (x, z), half_gauge, mass, half_size)


def robot_with_an_arm(rng, preset, folder):
    """A robot of 0.2 to 6 m and 1 to 5,000 kg with an arm of one to three joints, whose limits may
    exclude 0; arms that would reach the ground are drawn again.
    """
    length, mass, half_gauge, radius = random_size(rng)
    height = 2 * radius + 0.15 * length
    parts = [box_link("base", mass, (0.8 * length, half_gauge, 0.2 * length), (0, 0, height))]
    carrier = "base"
    at = (0.2 * length, 0, height + 0.12 * length)
    for k in range(rng.integers(1, 4)):
        arm = f"arm{k}"
        reach = length * rng.uniform(0.2, 0.6)
        own = mass * rng.uniform(0.02, 0.1)
        size = (reach, 0.1 * length, 0.1 * length)
        parts.append(box_link(arm, own, size, (reach / 2, 0, 0)))
        low = rng.uniform(-1.5, 1.0)
        limits = LIMITS.format(low, low + rng.uniform(0.3, 2.0))
        axis = rng.choice(["0 1 0", "0 0 1"])
        parts.append(joint(f"j{k}", "revolute", carrier, arm, at, axis, more=limits))
        carrier = arm
        at = (reach, 0, 0)
    hull = [[-length / 2, radius, radius], [length / 2, radius, radius]]
    text = f"half_gauge = {half_gauge}\nwidth = {half_gauge / 5}\nhull = {hull}\n"
    file = write(folder, parts, text)
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
    model = robot.model
    data = mujoco.MjData(model)
    model.opt.enableflags |= mujoco.mjtEnableBit.mjENBL_ENERGY
    data.qpos[:] = robot.qpos
    data.ctrl[:] = robot.control
    mujoco.mju_euler2Quat(data.qpos[3:7], [roll, pitch, 0.0], "XYZ")
    mujoco.mj_kinematics(model, data)
    data.qpos[2] += drop - lowest_point(robot, data)
    mujoco.mj_forward(model, data)
    start = data.energy.sum()
    weight = G * model.body_subtreemass[0]
    falling = np.sqrt(2 * drop / G)
    swinging = np.sqrt(2 * robot.half_length / G)
    duration = 1.5 * (1 + swinging) + 2 * falling
    step = model.opt.timestep
    steps = round(duration / step)
    height = np.empty(steps)
    gained = np.empty(steps)
    work = 0.0
    for k in range(steps):
        before = data.qvel.copy()
        mujoco.mj_step(model, data)
        gained[k] = data.energy.sum() - start - work  # before the step
        height[k] = data.qpos[2]
        speed = (before + data.qvel) / 2
        work += float(data.qfrc_actuator @ speed) * step
    landed = int(np.argmin(height))
    gain = gained.max() / weight - 0.005 * drop
    rebound = (height[landed:].max() - robot.qpos[2]) / drop
    return gain, rebound


def lowest_point(robot, data):
    """The lowest height of its belts, which are capsules, and of the boxes of chassis and arms."""
    model = robot.model
    belts = np.flatnonzero(np.isin(model.geom_bodyid, robot.belts.bodies))
    radius = model.geom_size[belts, 0]
    half_length = model.geom_size[belts, 1]
    upright = np.abs(data.geom_xmat[belts, 8])
    lowest = (data.geom_xpos[belts, 2] - radius - upright * half_length).min()
    for shape in np.flatnonzero((model.geom_type == BOX) & (model.geom_contype > 0)):
        corner = np.abs(data.geom_xmat[shape, 6:]) @ model.geom_size[shape]
        lowest = min(lowest, data.geom_xpos[shape, 2] - corner)
    return lowest


def checks_of(case, make, preset, rng, count):
    """Checks of robots released from up to 0.3 of their length, once tilted by up to 35 degrees and
    once level.
    """
    gains = np.empty(count)
    rebounds = np.empty(count)
    most_tilt = np.radians(35.0)
    for k in range(count):
        robot = make(rng, LevelGround(), preset)
        roll, steep = rng.uniform(-most_tilt, most_tilt, 2)
        slight = rng.normal(0.0, np.radians(3.0))
        pitch = rng.choice([steep, slight, 0.0])
        high = 2 * robot.half_length * rng.uniform(0.02, 0.3)
        drop = float(rng.choice([high, 1e-3]))
        gains[k], _ = release(robot, drop, roll, pitch)
        _, rebounds[k] = release(robot, high)
    yield Check(case, "energy gained, over the weight", max(0.0, gains.max()), ROUNDING, "m")
    yield Check(case, "rebound, over the drop", rebounds.max(), REBOUND)


@pytest.mark.parametrize(
    ("preset", "count"),
    [
        ("accurate", 12),
        pytest.param("accurate", 1000, marks=pytest.mark.slow),
        pytest.param("fast", 1000, marks=pytest.mark.slow),
    ],
)
def test_random_robots(preset, count):
    rng = np.random.default_rng(count)
    checks = [*checks_of("random robots", random_robot, preset, rng, count)]
    report(f"{count} releases, {preset}", checks)


@pytest.mark.parametrize(
    ("preset", "count"),
    [
        ("accurate", 12),
        pytest.param("accurate", 200, marks=pytest.mark.slow),
        pytest.param("fast", 200, marks=pytest.mark.slow),
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
    def make_box(_, terrain, preset):
        return box(terrain, preset)

    def make_rescue(_, terrain, preset):
        return rescue(terrain, preset)

    checks = [
        *checks_of("box", make_box, preset, np.random.default_rng(0), 60),
        *checks_of("rescue", make_rescue, preset, np.random.default_rng(0), 60),
    ]
    report(f"60 releases, {preset}", checks)
