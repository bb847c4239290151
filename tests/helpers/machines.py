"""Small machines on tracks and wheels as URDFs, and what they do on level ground in MuJoCo."""

from dataclasses import dataclass
from pathlib import Path

import mujoco
import numpy as np
import scipy

from sim.robot.named import load_tracked
from sim.robot.tracked_model import build_tracked, clear_angles
from trackslip.skid_theory import Contact, steady_twist

LIMITS = '<limit lower="{}" upper="{}" effort="200" velocity="2"/>'


def inertia_of_box(mass, x, y, z):
    """The <inertia> of a box of these edges: m / 12 (a^2 + b^2) about the third."""
    xx = mass / 12 * (y**2 + z**2)
    yy = mass / 12 * (x**2 + z**2)
    zz = mass / 12 * (x**2 + y**2)
    return f'<inertia ixx="{xx}" iyy="{yy}" izz="{zz}" ixy="0" ixz="0" iyz="0"/>'


def box(name, mass, size, at=(0, 0, 0)):
    """A link that is a box."""
    origin = f'<origin xyz="{at[0]} {at[1]} {at[2]}"/>'
    shape = f'<geometry><box size="{size[0]} {size[1]} {size[2]}"/></geometry>'
    inertial = f'<inertial>{origin}<mass value="{mass}"/>{inertia_of_box(mass, *size)}</inertial>'
    return f'<link name="{name}">{inertial}<collision>{origin}{shape}</collision></link>\n'


def joint(name, kind, parent, child, at, axis="0 1 0", turn="0 0 0", more=""):
    """A joint between two links."""
    ends = f'<parent link="{parent}"/><child link="{child}"/>'
    place = f'<origin xyz="{at[0]} {at[1]} {at[2]}" rpy="{turn}"/><axis xyz="{axis}"/>'
    return f'<joint name="{name}" type="{kind}">{ends}{place}{more}</joint>\n'


def wheel(
    name, at, parent="base", radius=0.1, axis="0 1 0", turn="1.5708 0 0", more="", width=0.06
):
    """A round link on an endless hinge."""
    shape = f'<geometry><cylinder radius="{radius}" length="{width}"/></geometry>'
    collision = f'<collision><origin rpy="{turn}"/>{shape}</collision>'
    mass = f'<mass value="1.5"/>{inertia_of_box(1.5, 2 * radius, width, 2 * radius)}'
    kind = "revolute" if more else "continuous"
    link = f'<link name="{name}"><inertial>{mass}</inertial>{collision}</link>\n'
    return link + joint(f"{name}_joint", kind, parent, name, at, axis, more=more)


def write(folder: Path, parts, text, name="machine"):
    """Write a URDF of these parts and its robot file; returns the latter's path."""
    model = f'<robot name="{name}">\n{"".join(parts)}</robot>\n'
    (folder / f"{name}.urdf").write_text(model)
    file = folder / f"{name}.toml"
    file.write_text(f'model = "{name}.urdf"\n{text}')
    return file


@dataclass(frozen=True)
class Driven:
    """What a machine did on level ground."""

    yaw_rate: float  # [rad/s]
    forwards: float  # speed of the chassis' frame ahead [m/s]
    load: np.ndarray  # (T,) [N]
    height: float  # of the chassis' frame [m]
    built: object
    data: mujoco.MjData


def drive(file, speeds=(0.0, 0.0), duration=6.0, preset="accurate", angles=None):
    """Put a machine on level ground and drive it with belts at these speeds, left and right; means
    over the second half.
    """
    robot = load_tracked(file)
    built = build_tracked(robot, preset=preset)
    model = built.model
    data = mujoco.MjData(model)
    place, velocity = built.free
    data.qpos[place : place + 7] = [0, 0, 0.001 - robot.lowest, 1, 0, 0, 0]
    if angles is None:
        angles = clear_angles(built)
    control = built.flipper_control(np.array(angles))
    data.qpos[built.flipper_qpos] = control
    data.ctrl[built.flipper_motor] = control
    built.belts.set(built.belt_speeds(np.array(speeds)))
    yaw_rates = []
    forwards = []
    loads = []
    period = 0.1
    steps = round(duration / period)
    for k in range(steps):
        mujoco.mj_step(model, data, nstep=round(period / model.opt.timestep))
        if k >= steps / 2:
            ahead = data.xmat[built.body].reshape(3, 3)[:, 0]
            yaw_rates.append(data.qvel[velocity + 5])
            forwards.append(data.qvel[velocity : velocity + 3] @ ahead)
            loads.append(built.belts.read(data).load)
    return Driven(
        yaw_rate=float(np.mean(yaw_rates)),
        forwards=float(np.mean(forwards)),
        load=np.mean(loads, axis=0),
        height=float(data.qpos[place + 2]),
        built=built,
        data=data,
    )


def yaw_rate_by_theory(points, speeds, centre_of_mass, friction=0.7):
    """Yaw rate by least power of contact points (x, y) with equal springs [rad/s]."""
    x, y = np.array(points, float).T
    ahead, left, height = centre_of_mass
    middle_x = x.mean()
    middle_y = y.mean()
    off = (ahead - middle_x, left - middle_y, height)
    contact = Contact(x - middle_x, y - middle_y, friction, friction, off)
    twist = steady_twist(np.array(speeds), contact)
    return float(twist[2])


def loads_of_equal_springs(points, centre_of_mass, weight):
    """Loads on points (x, y) with equal springs below a rigid robot of this weight [N]."""
    terms = np.column_stack([np.ones(len(points)), np.array(points, float)])
    moments = weight * np.array([1.0, centre_of_mass[0], centre_of_mass[1]])
    return terms @ np.linalg.solve(terms.T @ terms, moments)


def twist_of_least_power(points, loads, speeds, friction=0.7):
    """The twist (v, lateral u, w) at which friction at points (x, y) that bear these loads [N] and
    whose surfaces run at these speeds takes the least power.
    """
    x, y = np.array(points, float).T

    def power(twist):
        v, u, w = twist
        ahead = v - w * y - speeds
        left = u + w * x
        return friction * float(np.sum(loads * np.hypot(ahead, left)))

    start = [np.mean(speeds), 0.0, np.ptp(speeds) / np.ptp(y)]
    exact = {"xatol": 1e-8, "fatol": 1e-12, "maxiter": 10_000, "maxfev": 10_000}
    return scipy.optimize.minimize(power, start, method="Nelder-Mead", options=exact).x


def centre_of_mass(built):
    """Centre of mass of a machine at its start, in the chassis' frame but above the ground [m]."""
    data = mujoco.MjData(built.model)
    mujoco.mj_kinematics(built.model, data)
    mujoco.mj_comPos(built.model, data)
    x, y, z = data.subtree_com[built.body] - data.xpos[built.body]
    return float(x), float(y), float(z - built.robot.lowest)


def patches(places, length=0.1, count=10):
    """Points (x, y) of wheels' patches around these places."""
    along = length * ((np.arange(count) + 0.5) / count - 0.5)
    return [(x + each, y) for x, y in places for each in along]


def lines(y, half_length, middle=0.0, count=100):
    """Points (x, y) of a track."""
    along = 2 * half_length * ((np.arange(count) + 0.5) / count - 0.5)
    return [(middle + each, y) for each in along]
