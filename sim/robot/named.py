"""Robots by name or file, for flat ground (bodies on two rows of pads) and for terrain (models with
tracks).

`check` reports what a robot's files contain, what they leave out and what is wrong in them.
"""

from __future__ import annotations

import warnings
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import mujoco
import numpy as np

from sim.common.settings import build, read_named
from sim.ground.ground import Ground
from sim.robot.model_check import absolute
from sim.robot.parameters import WHEELS, RobotParameters
from sim.robot.robot import MODELS, composite, shaped_robot
from sim.robot.tracked import TrackedRobot
from sim.robot.tracked_model import TrackedModel, build_tracked, chassis_of, clear_angles, load_spec
from sim.robot.urdf import Refuse, engine_errors, refuse
from sim.robot.wheels import colliding, outline, own_wheels, start
from trackslip.errors import (
    InvalidValueError,
    RobotWarning,
    SettingsFileError,
    TrackslipError,
    counted,
    require,
)

SHIPPED = "shipped"
"""Name of the robot in models/tracked_robot.xml."""
_FILES = {
    **{name: MODELS / f"{name}_robot.toml" for name in ("rescue", "box")},
    **{name: MODELS / f"{name}.toml" for name in ("husky", "warthog", "maxxii")},
}
ROBOTS = (SHIPPED, *_FILES)
"""Names of the robots that come with the package."""
_PLATE_ABOVE = 0.1  # least height of the plate's lower edge above the rest of the robot [m]
_PLATE_HALF_HEIGHT = 0.1  # from models/tracked_robot.xml [m]
_BELT = 0.01  # thickness of a belt around its sprocket [m]


RobotSource = str | RobotParameters | TrackedRobot
"""A robot, its name or the path of its file."""
_SHARED = RobotParameters.__dataclass_fields__.keys() & TrackedRobot.__dataclass_fields__.keys()
_G, _SLOPE = 9.81, np.radians(20)  # [m/s^2, rad]


def load_parameters(source: RobotSource | Path = SHIPPED) -> tuple[RobotParameters, Ground]:
    """Load a robot for flat ground: its parameters, and the ground in the table `ground` of its
    file.

    The source is a name in `ROBOTS`, a robot, a file of parameters, whose missing fields keep their
    defaults, or the file of a tracked robot, which `on_flat_ground` converts. Raises
    InvalidValueError for an unknown source, SettingsFileError for an unreadable file or invalid
    fields, TrackslipError for a model that doesn't compile.
    """
    robot, ground = _load(source)
    if isinstance(robot, RobotParameters):
        return robot, ground
    try:
        return on_flat_ground(robot, "" if robot is source else str(source)), ground
    except InvalidValueError as error:
        raise SettingsFileError(f"{robot.model}: {error}") from error


def load_tracked(source: RobotSource | Path = "rescue", refuse: Refuse = refuse) -> TrackedRobot:
    """Load a robot for terrain, from the same sources as `load_parameters`; `on_terrain` converts
    parameters.

    `refuse` is called for each missing mesh that is needed to find the model's wheels; see
    `build_tracked`.
    """
    robot, _ = _load(source, refuse)
    if isinstance(robot, TrackedRobot):
        return robot
    if robot.looks:
        return load_tracked(robot.looks)
    return on_terrain(robot, "robot" if robot is source else Path(str(source)).stem)


def _load(
    source: RobotSource | Path, refuse: Refuse = refuse
) -> tuple[RobotParameters | TrackedRobot, Ground]:
    if isinstance(source, RobotParameters | TrackedRobot):
        return source, Ground()
    if str(source) == SHIPPED:
        return RobotParameters(), Ground()
    name = str(_FILES.get(str(source), source))
    is_model = name.lower().endswith((".urdf", ".xacro", ".xml", ".sdf"))
    require(
        not is_model,
        "robot",
        name,
        "a .toml file that names this model and its tracks: see docs/your_robot.md",
    )
    path, table = Path(name), read_named("robot", name, ROBOTS)
    ground = build(Ground, table.pop("ground", {}), f"{path}: ground", Ground())
    if any(field in TrackedRobot.__dataclass_fields__ and field not in _SHARED for field in table):
        return _tracked(path, table, refuse), ground
    # what a file leaves out is the shipped robot's, except its motors, which are for 25 kg
    return build(RobotParameters, table, str(path), RobotParameters(drive=None)), ground


def on_flat_ground(robot: TrackedRobot, looks: str = "") -> RobotParameters:
    """The parameters of a tracked robot on level ground: a rigid body that stands on the longest
    runs of its tracks.

    Its joints stay in their starting positions, its flippers as low as possible without touching
    the ground. Its frame is in the middle of the runs, its sprockets are as large as its largest
    wheels, and the plate stands above the rest of the robot. It is drawn as the robot with the name
    or file `looks`. Raises InvalidValueError for a robot out of range or that doesn't stand on two
    wheels of each track, TrackslipError for a model that can't be compiled.
    """
    built = build_tracked(robot, looks=True)
    model = built.model
    with engine_errors(robot.model):
        data = _stand(built)
        own = np.flatnonzero(model.body_rootid == built.body)
        mass, (x, y, z), total = composite(model, data, own)
        shapes = np.flatnonzero(model.body_rootid[model.geom_bodyid] == built.body).tolist()
        top = max(float(outline(model, data, data.body(0), shape)[:, 2].max()) for shape in shapes)
    contact: dict[str, Any] = {"contact_length": robot.contact_length}
    if robot.contact == WHEELS:
        axles = tuple(axle - robot.middle for axle in robot.standing)
        contact = {"contact": WHEELS, "axles": axles, "patch_length": robot.patch_length}
    return RobotParameters(
        half_gauge=robot.half_gauge,
        **contact,
        sprocket_radius=robot.sprocket_radius,
        radius_error=0.0,
        mass=mass,
        com_x=float(x),
        com_y=float(y),
        com_height=float(z),
        inertia=tuple(total[[0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]].tolist()),
        plate_height=max(RobotParameters.plate_height, top + _PLATE_ABOVE + _PLATE_HALF_HEIGHT),
        looks=looks,
        drive=robot.drive,
    )


def _stand(built: TrackedModel) -> mujoco.MjData:
    """Data of a robot that stands on level ground, with the middle of its runs at the origin."""
    robot, data, first = built.robot, start(built.model), built.free[0]
    data.qpos[first : first + 7] = [-robot.middle, 0.0, -robot.lowest, 1.0, 0.0, 0.0, 0.0]
    data.qpos[built.flipper_qpos] = built.flipper_control(clear_angles(built))
    mujoco.mj_kinematics(built.model, data)
    mujoco.mj_comPos(built.model, data)
    return data


def on_terrain(parameters: RobotParameters, name: str) -> TrackedRobot:
    """The robot with these parameters: the shipped robot's body on wheels, or on tracks as long as
    the contact.
    """
    radius, half = parameters.sprocket_radius, parameters.contact_length / 2
    ends, radius = (
        (parameters.axles, radius) if parameters.axles else ((-half, half), radius + _BELT)
    )
    hull, shared = (
        tuple((x, radius, radius) for x in ends),
        {each: getattr(parameters, each) for each in _SHARED},
    )
    return PlainRobot(
        MODELS / "tracked_robot.xml", hull=hull, name=name, parameters=parameters, **shared
    )


@dataclass(frozen=True)
class PlainRobot(TrackedRobot):
    """The shipped robot, or a robot that differs from it only in its parameters, on tracks instead
    of pads.
    """

    parameters: RobotParameters = field(default_factory=RobotParameters)
    """Shape, mass and motors of the robot."""

    @property
    def sprocket_radius(self) -> float:
        """Nominal radius of the sprockets, without the belts around them [m]."""
        return self.parameters.sprocket_radius

    def spec(self) -> Any:
        """The shipped model with this robot's parameters, without pads; see TrackedRobot."""
        spec = shaped_robot(self.parameters, self.model.name)
        pads = [geom for geom in spec.geoms if "_pad" in geom.name]
        for thing in (*spec.pairs, *spec.sensors, *pads):
            spec.delete(thing)
        # the time step in the file is for pads
        spec.option.timestep = mujoco.MjSpec().option.timestep
        spec.authored.option = 0
        hull = spec.geom("hull")
        hull.contype = hull.conaffinity = 1
        return spec


def _tracked(path: Path, table: Mapping[str, Any], refuse: Refuse = refuse) -> TrackedRobot:
    wheels = table.get("wheels", [])
    if isinstance(wheels, str) and wheels != "replace":
        raise SettingsFileError(
            f'{path}: wheels = {wheels!r}: must be "replace" or a list of links'
        )
    given = {name: value for name, value in table.items() if value != "replace" or name != "wheels"}
    # until they are read
    unknown = {"half_gauge": 1.0, "hull": [[-1, 0, 1], [1, 0, 1]]} if wheels else {}
    robot = build(
        TrackedRobot, {"name": path.stem.removesuffix("_robot"), **unknown, **given}, str(path)
    )
    folder = path.parent
    model, packages = folder / robot.model, [folder / each for each in robot.packages]
    if absolute(folder) in absolute(model).parent.parents:
        packages.append(folder)  # what lies beside a robot file belongs to its robot
    robot = replace(robot, model=model, packages=tuple(packages))
    if not wheels or {"wheels", "half_gauge", "hull"} <= given.keys():
        return robot
    with (
        engine_errors(robot.model),
        warnings.catch_warnings(action="ignore", category=RobotWarning),
    ):
        spec = load_spec(replace(robot, wheels=()), refuse=refuse)
        own = own_wheels(spec, chassis_of(spec, robot).name, robot, given)
    try:
        return replace(robot, **{name: value for name, value in own.items() if name not in given})
    except InvalidValueError as error:
        hint = "; give `hull`" if error.field == "hull" else ""
        raise SettingsFileError(f"{path}: of its wheels, {error}{hint}") from error


@dataclass(frozen=True)
class RobotCheck:
    """The results of checking a robot."""

    facts: tuple[tuple[str, str], ...]
    """Names and values of the robot's properties."""
    warnings: tuple[str, ...]
    """Lines on parts that are left out or look wrong."""
    errors: tuple[str, ...]
    """Lines on faults that keep the robot from driving."""

    def __str__(self) -> str:
        lines = [f"{name}: {value}" for name, value in self.facts]
        lines += [f"warning: {line}" for line in self.warnings] + [
            f"error: {line}" for line in self.errors
        ]
        return "\n".join(lines)


def check(source: RobotSource | Path = SHIPPED) -> RobotCheck:
    """Check a robot, by name or file, and collect all of its faults instead of stopping at the
    first error.
    """
    facts: list[tuple[str, str]] = []
    errors: list[str] = []
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always")
        try:
            robot = load_tracked(source, errors.append)
            facts += [
                ("model", robot.model.name),
                (
                    "contact",
                    f"{robot.contact}, half gauge {robot.half_gauge:g} m, "
                    f"{robot.contact_length:.4g} m long",
                ),
                (
                    "wheels (x, z, radius)",
                    ", ".join(f"({x:g}, {z:g}, {r:g})" for x, z, r in robot.hull),
                ),
                ("links replaced", ", ".join(robot.wheels) or "none"),
            ]
            build_tracked(robot, looks=True, refuse=errors.append)
            built = build_tracked(robot, refuse=lambda _: None)
            with engine_errors(robot.model):
                facts += _facts(built)
        except TrackslipError as error:
            errors.append(str(error))
        if not errors:
            try:
                load_parameters(source)
            except TrackslipError as error:
                warnings.warn(f"not for flat ground: {error}", RobotWarning, stacklevel=2)
    lines = dict.fromkeys(str(each.message) for each in said)
    return RobotCheck(tuple(facts), tuple(lines), tuple(dict.fromkeys(errors)))


def _facts(tracked: TrackedModel) -> list[tuple[str, str]]:
    """Names and values of a compiled robot's properties: mass, inertia, joints, flippers and
    motors.
    """
    robot = tracked.robot
    model = tracked.model
    own = np.flatnonzero(model.body_rootid == tracked.body)
    mass, (x, y, z), inertia = composite(model, _stand(tracked), own)
    held = [model.joint(int(k)).name for k in model.actuator_trnid[:, 0] if k >= 0]
    swings = np.flatnonzero(model.jnt_type != mujoco.mjtJoint.mjJNT_FREE).tolist()
    loose = [name for name in (model.joint(k).name for k in swings) if name not in held]
    needed = np.sin(_SLOPE) * mass * _G * robot.sprocket_radius / 2
    motors = "unlimited, without a table [drive]"
    if robot.drive is not None:
        motors = f"{robot.drive.strength(0.0):.3g} N m a side"
    return [
        ("mass", f"{mass:.4g} kg, {x:+.3f} m ahead, {y:+.3f} m left, {z:.3f} m above the ground"),
        (
            "inertia",
            f"{', '.join(f'{value:.3g}' for value in inertia.diagonal())} kg m^2 about x, y, z",
        ),
        ("what collides", counted(int(colliding(model)[model.geom_bodyid > 0].sum()), "shape")),
        ("joints with motors", ", ".join(held) or "none"),
        ("joints without", ", ".join(loose) or "none"),
        ("flippers", ", ".join(robot.flipper_bodies) or "none"),
        ("motors", f"{motors}; 20 degrees uphill take {needed:.3g} N m a side"),
    ]
