"""Robots by name or file, for flat ground (bodies on two rows of pads) and for terrain (models with
tracks).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import mujoco

from sim.common.settings import build, read_named
from sim.ground.ground import Ground
from sim.robot.flat import on_flat_ground
from sim.robot.joint_rules import joint_rules
from sim.robot.model_check import absolute
from sim.robot.parameters import RobotParameters
from sim.robot.robot import MODELS, shaped_robot
from sim.robot.tracked import TrackedRobot
from sim.robot.tracked_model import complete
from sim.robot.urdf import Refuse, refuse
from trackslip.arguments import checks_arguments
from trackslip.errors import (
    InvalidValueError,
    SettingsFileError,
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
_BELT = 0.01  # thickness of a belt around its sprocket [m]


RobotSource = str | RobotParameters | TrackedRobot
"""A robot, its name or the path of its file."""
_SHARED = RobotParameters.__dataclass_fields__.keys() & TrackedRobot.__dataclass_fields__.keys()


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


@checks_arguments
def load_tracked(source: RobotSource | Path = "rescue", refuse: Refuse = refuse) -> TrackedRobot:
    """Load a robot for terrain, from the same sources as `load_parameters`; `on_terrain` converts
    parameters.

    `refuse` is called for each missing mesh that is needed to find the model's wheels; see
    `build_tracked`.
    """
    robot, _ = _load(source, refuse)
    if isinstance(robot, TrackedRobot):
        return robot if robot.hull else complete(robot, refuse=refuse)
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


def on_terrain(parameters: RobotParameters, name: str) -> TrackedRobot:
    """The robot with these parameters: the shipped robot's body on wheels, or on tracks as long as
    the contact.
    """
    radius = parameters.sprocket_radius
    ends = parameters.axles
    if not ends:
        radius += _BELT
        half = parameters.contact_length / 2
        ends = (-half, half)
    return PlainRobot(
        MODELS / "tracked_robot.xml",
        hull=tuple((x, radius, radius) for x in ends),
        name=name,
        half_gauge=parameters.half_gauge,
        contact=parameters.contact,
        patch_length=parameters.patch_length,
        drive=parameters.drive,
        parameters=parameters,
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
    """The robot of a file with these fields; see TrackedRobot."""
    given = dict(table)
    wheels = given.get("wheels", [])
    replaces_all = wheels == "replace"
    if isinstance(wheels, str) and not replaces_all:
        raise SettingsFileError(
            f'{path}: wheels = {wheels!r}: must be "replace" or a list of links'
        )
    if replaces_all:
        del given["wheels"]
    rules = joint_rules(given.pop("joints", {}), f"{path}: joints")
    own = {name for name in ("half_gauge", "hull", "offset") if name in given}
    if "tracks" in given and own:
        raise SettingsFileError(
            f"{path}: {', '.join(sorted(own))}: must be left out beside [[tracks]], which have `y` "
            "and `hull`"
        )

    # until they are read
    unknown: dict[str, Any] = {}
    if wheels and "tracks" not in given:
        unknown = {"half_gauge": 1.0, "hull": [[-1, 0, 1], [1, 0, 1]]}
    named = {"name": path.stem.removesuffix("_robot"), **unknown, **given}
    robot = replace(build(TrackedRobot, named, str(path)), joints=rules)
    folder = path.parent
    model = folder / robot.model
    packages = [folder / each for each in robot.packages]
    if absolute(folder) in absolute(model).parent.parents:
        packages.append(folder)  # what lies beside a robot file belongs to its robot
    robot = replace(robot, model=model, packages=tuple(packages))
    if {"half_gauge", "hull"} <= own and not wheels:
        return replace(robot, origin="given")
    try:
        return complete(robot, tuple(own), replaces_all, refuse)
    except InvalidValueError as error:
        raise SettingsFileError(f"{path}: {error}") from error
