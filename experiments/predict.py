"""`trackslip predict`: compute slip from theory, without simulating."""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, ClassVar

from experiments.common.choices import SHIPPED
from experiments.common.options import (
    Distinct,
    Excludes,
    Exclusion,
    Needs,
    Positive,
    ResultsOptions,
    Within,
    default_is,
)
from experiments.common.run import Run
from experiments.common.table import Table
from experiments.simulate.options import (
    MAX_RADIUS,
    MIN_FRICTION_RATIO,
    MIN_RADIUS,
    RADIUS_ERROR,
    RobotSource,
)
from sim.drive.drive import MAX_FORCE, Pull
from sim.ground.ground import MAX_FRICTION, Ground
from sim.robot.named import load_parameters
from sim.robot.parameters import RobotParameters
from trackslip.errors import InvalidValueError
from trackslip.files import FORMAT
from trackslip.identification.source import MULTIPLIERS
from trackslip.paper import OBSERVED_RADII
from trackslip.skid_theory import Load, steady_turns, steady_twist

EXAMPLES = (
    ("the shipped robot", "trackslip predict"),
    ("uphill on ground that shears", "trackslip predict --shear 0.01 --slope 0.17"),
    (
        "turns counted by hand: 10 by odometry, 7.9 really",
        "trackslip predict --turns 10 --measured 7.9",
    ),
    (
        "a robot of another size",
        "trackslip predict --half-gauge 0.25 --contact-length 0.6 --friction-ratio 1.2",
    ),
)
_HEADER = ("radius driven [m]", "outer slip", "inner slip", "D [mm]", "ICRs, left | right [mm]")
_GRAVITY = 9.81  # [m/s^2]
_ROBOTS = default_is("the robot's", "FLOAT")


@dataclass(frozen=True)
class Config(ResultsOptions):
    """Predict slip from quasi-static theory, without simulating: a law for Coulomb ground, slips
    for other ground.

    With --shear, --slope or --pull, slips depend on radius and load; the law then fits their mean
    over the radii. With --turns and --measured, turns counted by hand give
    wheel_separation_multiplier and D; nothing else is computed.
    """

    turns: Annotated[float | None, Positive(1e6), default_is("none", "FLOAT")] = None
    """Turns on the spot according to wheel odometry, as commanded or as counted; needs --measured
    [-].
    """
    measured: Annotated[float | None, Positive(1e6), default_is("none", "FLOAT")] = None
    """Turns that the robot actually made meanwhile; needs --turns [-]."""
    multiplier: Annotated[float, Within(*MULTIPLIERS)] = 1.0
    """wheel_separation_multiplier that the odometry used; needs --turns [-]."""
    robot: RobotSource = SHIPPED
    """Robot that supplies the values not given below."""
    half_gauge: Annotated[float | None, Positive(100.0), _ROBOTS] = None
    """Half the distance between the tracks [m]."""
    contact_length: Annotated[float | None, Positive(100.0), _ROBOTS] = None
    """Length of a track on the ground [m]."""
    friction_ratio: Annotated[float | None, Within(MIN_FRICTION_RATIO, 100.0), _ROBOTS] = None
    """Friction across the track over friction along it; without a load, slip depends on no other
    friction [-].
    """
    friction: Annotated[
        float | None, Positive(MAX_FRICTION), default_is("the robot's ground's", "FLOAT")
    ] = None
    """Friction coefficient along the track; needs --slope or --pull [-]."""
    shear: Annotated[float | None, default_is("the robot's ground's", "FLOAT")] = None
    """Shear modulus of ground that gives way before it slides, 0 for Coulomb friction [m]."""
    slope: float = 0.0
    """Angle of the ground to the horizontal [rad]."""
    uphill: float = 0.0
    """Direction of uphill relative to the robot, 0 straight ahead, positive to the left; needs
    --slope [rad].
    """
    pull: Annotated[float, Within(0, MAX_FORCE, "N")] = 0.0
    """Drawbar force, backwards along the robot [N]."""
    pull_height: Annotated[float, Within(0, 10, "m")] = Pull.height
    """Height of the hitch above the ground; needs --pull [m]."""
    com_x: Annotated[float | None, _ROBOTS] = None
    """Centre of mass, forward of the middle of the tracks [m]."""
    sprocket_radius: Annotated[float | None, Positive(100.0), _ROBOTS] = None
    """Radius of the sprockets, stored with the law; slip does not depend on it [m]."""
    radius_error: Annotated[float, RADIUS_ERROR] = 0.0
    """Relative error of the effective sprocket radius, real / nominal - 1 [-]."""
    radii: Annotated[tuple[float, ...], Distinct("radius"), Within(MIN_RADIUS, MAX_RADIUS, "m")] = (
        OBSERVED_RADII
    )
    """Driven radii that the table lists [m]."""
    out: Path = Path("out/predict")
    """Folder for the results."""

    exclusions: ClassVar[tuple[Exclusion, ...]] = (
        Needs(("uphill",), "slope"),
        Needs(("pull_height",), "pull"),
        Needs(("measured", "multiplier"), "turns"),
        Needs(("turns",), "measured"),
        Excludes(
            (
                *("contact_length", "friction_ratio", "friction", "shear", "slope", "uphill"),
                *("pull", "pull_height", "com_x", "sprocket_radius", "radius_error", "radii"),
                *("out", "overwrite"),
            ),
            "turns",
        ),
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        Ground(shear=self.shear or 0.0, slope=self.slope, uphill=self.uphill)
        if self.friction is not None and self.slope == 0 and self.pull == 0:
            raise InvalidValueError(
                "friction", self.friction, "left out without --slope and --pull"
            )


def run(config: Config) -> None:
    """Compute the slips, and store and print them."""
    robot, ground, load = predicted_world(config)
    if config.turns is not None and config.measured is not None:
        multiplier = config.multiplier * config.turns / config.measured
        Within(*MULTIPLIERS).check("turns / measured × multiplier", multiplier)
        offset = 1e3 * robot.half_gauge * (multiplier - 1)
        print(
            f"wheel_separation_multiplier  {multiplier:.3f}, where odometry had "
            f"{config.multiplier:g}"
        )
        print(
            f"D  {offset:.1f} mm for half_gauge = {robot.half_gauge:g} m, if the sprockets' "
            "radius is right (ε = 0)"
        )
        return
    contact = robot.contact_theory(ground.along, ground.across)
    turns = steady_turns(config.radii, contact, ground.shear, load)
    # nominal: for slips of the nominal sprocket
    loss, nominal = float(turns.loss.mean()), 1 + config.radius_error
    law = {"offset": float(turns.offset.mean()), "radius_error": nominal * (1 - loss) - 1}
    ahead = steady_twist([1.0, 1.0], contact, shear=ground.shear, load=load)[0]
    slip, straight = 1 - nominal * (1 - turns.slip), float(1 - nominal * ahead)
    varies = ground.shear > 0 or config.slope != 0 or config.pull != 0
    summary = {
        "format": FORMAT,
        "geometry": {"half_gauge": robot.half_gauge, "sprocket_radius": robot.sprocket_radius},
        "slip_laws": {"icr_radius": {"values": law}},
        "radius": list(config.radii),
        "slip": {"outer": slip[:, 1], "inner": slip[:, 0]},
        "offset": turns.offset,
        "icr": {"left": turns.icr[:, 0], "right": turns.icr[:, 1]},
        "straight_slip": straight,
        "shear": ground.shear,
        "load": load,
        "friction": [ground.along, ground.across],
    }
    with Run(config) as run:
        run.write(summary)
    rows = [
        (
            f"{r:g}",
            f"{outer:+.4f}",
            f"{inner:+.4f}",
            f"{1e3 * d:.2f}",
            f"{1e3 * left:+.1f} | {1e3 * right:+.1f}",
        )
        for r, (inner, outer), d, (left, right) in zip(
            config.radii, slip, turns.offset, turns.icr, strict=True
        )
    ]
    if varies:
        rows.append(("straight", f"{straight:+.4f}", f"{straight:+.4f}", "", ""))
    columns = len(_HEADER) if varies else 3
    title = f"Slip by quasi-static theory, K = {1e3 * ground.shear:g} mm"
    Table(title, _HEADER[:columns], [row[:columns] for row in rows]).print()
    print(
        f"{'mean ' if varies else ''}D = {1e3 * law['offset']:.2f} mm; use it with --laws "
        f"{config.out}"
    )


def predicted_world(config: Config) -> tuple[RobotParameters, Ground, Load]:
    """The robot with its centre of mass midway between the tracks, level ground, and the load from
    slope and pull.
    """
    robot, ground = load_parameters(config.robot)
    ground.require_even("the ground of --robot is even and level here, and --slope tilts it")
    given = {name: getattr(config, name) for name in ("half_gauge", "com_x", "sprocket_radius")}
    robot = replace(
        robot, com_y=0.0, **{name: value for name, value in given.items() if value is not None}
    )
    if config.contact_length is not None:
        robot = robot.with_contact_length(config.contact_length)
    along = ground.along if config.friction is None else config.friction
    ratio = ground.across / ground.along if config.friction_ratio is None else config.friction_ratio
    shear = ground.shear if config.shear is None else config.shear
    load = Load(
        config.slope, config.uphill, config.pull / (robot.mass * _GRAVITY), config.pull_height
    )
    return robot, Ground(along, ratio * along, shear=shear), load
