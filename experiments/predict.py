"""`trackslip predict`: compute slip from theory, without simulating, or multipliers from turns and
distances measured by hand.
"""

import math
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Any, ClassVar, Final, Literal

import tyro

from experiments.common.choices import GROUNDS, SHIPPED
from experiments.common.options import (
    Bound,
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
from experiments.common.soil import OnSoil
from experiments.common.table import Table
from experiments.simulate.options import (
    MAX_RADIUS,
    MIN_FRICTION_RATIO,
    MIN_RADIUS,
    RADIUS_ERROR,
    RobotSource,
)
from sim.ground.ground import MAX_FRICTION, Ground, load_ground
from sim.ground.pull import MAX_FORCE, Pull
from sim.robot.named import load_parameters
from sim.robot.parameters import RobotParameters
from trackslip.errors import InvalidValueError, require
from trackslip.files import FORMAT
from trackslip.identification.source import MULTIPLIERS
from trackslip.kinematics import Array
from trackslip.paper import OBSERVED_RADII
from trackslip.skid_theory import Load, steady_turns, steady_twist

EXAMPLES: Final = (
    ("the shipped robot", "trackslip predict"),
    (
        "uphill on ground that shears",
        "trackslip predict --shear 0.01 --slope 0.17 --out out/shearing",
    ),
    (
        "soft soil: sinkage, and the drawbar pull over slip",
        "trackslip predict --ground dry_sand --out out/soft",
    ),
    (
        "turns counted by hand: 10 by odometry to each side, 7.9 and 8.1 really",
        "trackslip predict --turns 10 -10 --measured 7.9 -8.1",
    ),
    (
        "a distance by tape: 10 m by odometry, 9.8 m really",
        "trackslip predict --drove 10 --measured 9.8",
    ),
    (
        "a robot of another size",
        "trackslip predict --half-gauge 0.25 --contact-length 0.6 --out out/larger",
    ),
)
ESSENTIAL: Final = (
    "robot",
    "half_gauge",
    "contact_length",
    "friction_ratio",
    "shear",
    "slope",
    "turns",
    "drove",
    "measured",
    "out",
    "overwrite",
)
_HEADER: Final = (
    "radius driven [m]",
    "outer slip",
    "inner slip",
    "D [mm]",
    "ICRs, left | right [mm]",
)
_GRAVITY: Final = 9.81  # [m/s^2]
_ROBOTS: Final = default_is("the robot's", "FLOAT")


_OF_THEORY: Final = (
    "contact_length",
    "ground",
    "friction_ratio",
    "friction",
    "shear",
    "slope",
    "uphill",
    "pull",
    "pull_height",
    "com_x",
    "sprocket_radius",
    "radius_error",
    "radii",
    "out",
    "overwrite",
)
"""Options without effect on what is computed from turns or distances by hand."""
_UNITS: Final = {
    "turns": {"turn": 1.0, "deg": 1 / 360, "rad": 1 / (2 * math.pi)},
    "drove": {"m": 1.0, "cm": 1e-2, "mm": 1e-3},
}
"""Units of turns and distances, with their factors to turns and metres."""
_LIKE: Final = 0.01  # relative difference of directions up to which they count as alike [-]


class ByHand(Bound):
    """Finite numbers other than 0."""

    def _check_number(self, name: str, number: float) -> None:
        if not (math.isfinite(number) and number != 0 and abs(number) <= 1e6):
            raise InvalidValueError(name, number, "a finite number other than 0, up to 1e6")


@dataclass(frozen=True)
class Config(ResultsOptions):
    """Predict slip from quasi-static theory, without simulating: a law for Coulomb ground, slips
    for other ground.

    With --shear, --slope or --pull, slips depend on radius and load; the law then fits their mean
    over the radii. With --turns and --measured, turns counted by hand give
    wheel_separation_multiplier and D; with --drove and --measured, distances by tape give the
    wheel_radius_multipliers; nothing else is computed.
    """

    turns: Annotated[tuple[float, ...] | None, ByHand(), default_is("none", "FLOAT ...")] = None
    """Turns on the spot according to wheel odometry, as commanded or as counted, negative to the
    right; needs --measured [turn].
    """
    drove: Annotated[tuple[float, ...] | None, ByHand(), default_is("none", "FLOAT ...")] = None
    """Distances straight ahead according to wheel odometry, negative backwards; needs --measured
    [m].
    """
    measured: Annotated[tuple[float, ...] | None, ByHand(), default_is("none", "FLOAT ...")] = None
    """What the robot actually turned or drove each time; needs --turns or --drove [turn or m]."""
    unit: Annotated[
        Literal["turn", "deg", "rad", "m", "cm", "mm"] | None,
        default_is("turn or m", "{turn,deg,rad,m,cm,mm}"),
    ] = None
    """Unit of --turns (turn, deg, rad) or --drove (m, cm, mm), and of --measured."""
    multiplier: Annotated[float, Within(*MULTIPLIERS)] = 1.0
    """wheel_separation_multiplier that the odometry used; needs --turns [-]."""
    robot: RobotSource = SHIPPED
    """Robot that supplies the values not given below."""
    half_gauge: Annotated[float | None, Positive(100.0), _ROBOTS] = None
    """Half the distance between the tracks [m]."""
    contact_length: Annotated[float | None, Positive(100.0), _ROBOTS] = None
    """Length of a track on the ground [m]."""
    ground: Annotated[
        str | None,
        tyro.conf.arg(metavar=GROUNDS, help_behavior_hint="(default: the robot's, else stone)"),
    ] = None
    """Ground that supplies the values not given below; on soft soil, sinkage and the drawbar pull
    over slip are computed as well.
    """
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
    radius_error: Annotated[float | None, RADIUS_ERROR, _ROBOTS] = None
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
        Needs(("multiplier",), "turns"),
        Needs(("turns", "drove", "unit"), "measured"),
        Excludes(("drove", *_OF_THEORY), "turns"),
        Excludes(("robot", "half_gauge", *_OF_THEORY), "drove"),
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        Ground(shear=self.shear or 0.0, slope=self.slope, uphill=self.uphill)
        if self.friction is not None and self.slope == 0 and self.pull == 0:
            raise InvalidValueError(
                "friction", self.friction, "left out without --slope and --pull"
            )
        if self.measured is not None:
            _check_by_hand(self)

    @property
    def stores_results(self) -> bool:
        """Whether slip is computed from theory, not only a number from what was counted by hand."""
        return self.measured is None


def run(config: Config) -> None:
    """Compute the slips, and store and print them."""
    if config.turns is not None:
        _print_turns(config)
        return
    if config.drove is not None:
        _print_distances(config)
        return
    robot, ground, load = predicted_world(config)
    contact = robot.contact_theory(ground.along, ground.across)
    shear = ground.shear
    about_soil: dict[str, Any] = {}
    if ground.soil is not None:
        on_soil = OnSoil(robot, ground.soil, load)
        curve = on_soil.curve()
        about_soil = on_soil.summary(curve)
        on_soil.print(curve)
        if math.isnan(on_soil.slip()):
            _write(config, about_soil)
            return
        contact, shear, load = on_soil.turning()
    turns = steady_turns(config.radii, contact, shear, load)
    speed_ahead, *_ = steady_twist([1.0, 1.0], contact, shear=shear, load=load)

    # slips and losses are those of the nominal sprocket
    nominal = 1 + robot.radius_error
    slip = 1 - nominal * (1 - turns.slip)
    straight = float(1 - nominal * speed_ahead)
    loss = float(turns.loss.mean())
    law = {"offset": float(turns.offset.mean()), "radius_error": nominal * (1 - loss) - 1}

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
        "friction": [contact.along, contact.across],
        **about_soil,
    }
    _write(config, summary)

    varies = ground.shear > 0 or config.slope != 0 or config.pull != 0
    rows = [
        _turn_row(*values)
        for values in zip(config.radii, slip, turns.offset, turns.icr, strict=True)
    ]
    if varies:
        rows.append(("straight", f"{straight:+.4f}", f"{straight:+.4f}", "", ""))
    columns = len(_HEADER) if varies else 3
    title = f"Slip by quasi-static theory, K = {1e3 * ground.shear:g} mm"
    Table(title, _HEADER[:columns], [row[:columns] for row in rows]).print()
    mean = "mean " if varies else ""
    print(f"{mean}D = {1e3 * law['offset']:.2f} mm; use it with --laws {config.out}")


def _write(config: Config, summary: dict[str, Any]) -> None:
    """Store the results."""
    with Run(config) as run:
        run.write(summary)


def _turn_row(radius: float, slip: Array, offset: float, icr: Array) -> tuple[str, ...]:
    """A row for a turn: radius [m], slips and ICRs (2,) of the left and right track, and D [m]."""
    inner, outer = slip
    left, right = 1e3 * icr
    return (
        f"{radius:g}",
        f"{outer:+.4f}",
        f"{inner:+.4f}",
        f"{1e3 * offset:.2f}",
        f"{left:+.1f} | {right:+.1f}",
    )


def _check_by_hand(config: Config) -> None:
    """Raise InvalidValueError unless each turn or distance was measured, in a unit of its kind."""
    name = "turns" if config.turns is not None else "drove"
    counted = getattr(config, name)
    measured = config.measured or ()
    require(counted is not None, "measured", measured, "left out without --turns or --drove")
    what = f"as many numbers as --{name} has, {len(counted)}"
    require(len(measured) == len(counted), "measured", measured, what)
    for number, real in zip(counted, measured, strict=True):
        sign = "positive" if number > 0 else "negative"
        require(real * number > 0, "measured", real, f"{sign}, like {number:g} of --{name}")
    allowed = _UNITS[name]
    require(config.unit in (None, *allowed), "unit", config.unit, f"{', '.join(allowed)} ({name})")


def _print_turns(config: Config) -> None:
    """Print the multiplier and D from turns counted by hand."""
    assert config.turns is not None
    assert config.measured is not None
    robot, _, _ = predicted_world(config)
    ratios = _ratios(config.turns, config.measured, config.multiplier)
    multiplier = ratios["both"]
    Within(*MULTIPLIERS).check("turns / measured × multiplier", multiplier)
    offset = 1e3 * robot.half_gauge * (multiplier - 1)
    print(
        f"wheel_separation_multiplier  {multiplier:.3f}, where odometry had {config.multiplier:g}"
    )
    total = sum(map(abs, config.measured)) * _UNITS["turns"][config.unit or "turn"]
    print(
        f"D  {offset:.1f} mm for half_gauge = {robot.half_gauge:g} m, if the sprockets' radius is "
        f"right (ε = 0); a tenth of a turn miscounted changes the multiplier by "
        f"{multiplier * 0.1 / total:.2g}"
    )
    if {"positive", "negative"} <= ratios.keys():
        left = ratios["positive"]
        right = ratios["negative"]
        print(f"to the left {left:.3f}, to the right {right:.3f}: {_likeness(left, right)}")
        if not _are_alike(left, right):
            print(
                "radii that differ turn a robot alike to both sides: count again, from standstill "
                "to standstill; if the sides still differ, the slip does, as on a slope or with a "
                "load off the middle, and one multiplier is only their mean"
            )


def _print_distances(config: Config) -> None:
    """Print the multipliers of the radii and ε from distances measured by hand."""
    assert config.drove is not None
    assert config.measured is not None
    ratios = _ratios(config.measured, config.drove, 1.0)
    multiplier = ratios["both"]
    Within(*MULTIPLIERS).check("measured / drove", multiplier)
    print(f"left_wheel_radius_multiplier   {multiplier:.4f}, times that which odometry had")
    print(f"right_wheel_radius_multiplier  {multiplier:.4f}, times that which odometry had")
    total = sum(map(abs, config.drove)) * _UNITS["drove"][config.unit or "m"]
    print(
        f"ε  {100 * (multiplier - 1):+.2f} %, the mean of both sides: distances don't tell them "
        f"apart; 1 cm measured wrong changes it by {1 / total:.2g} %"
    )
    if {"positive", "negative"} <= ratios.keys():
        ahead = ratios["positive"]
        back = ratios["negative"]
        print(f"forwards {ahead:.4f}, backwards {back:.4f}: {_likeness(ahead, back)}")
        if not _are_alike(ahead, back):
            print(
                "radii are the same in both directions: measure again; if the directions still "
                "differ, the slip does, as on a slope"
            )


def _ratios(above: tuple[float, ...], below: tuple[float, ...], times: float) -> dict[str, float]:
    """Ratios of the sums of `above` (n,) and `below` (n,), `times` a factor: of both directions,
    and of the positive and the negative numbers, if there are any.
    """
    pairs = list(zip(above, below, strict=True))
    directions = {
        "both": pairs,
        "positive": [pair for pair in pairs if pair[0] > 0],
        "negative": [pair for pair in pairs if pair[0] < 0],
    }
    ratios = {}
    for name, some in directions.items():
        if some:
            sum_above = sum(abs(number) for number, _ in some)
            sum_below = sum(abs(number) for _, number in some)
            ratios[name] = times * sum_above / sum_below
    return ratios


def _are_alike(first: float, second: float) -> bool:
    """Whether two multipliers differ by no more than counting by hand makes them differ."""
    return abs(first - second) <= _LIKE * min(first, second)


def _likeness(first: float, second: float) -> str:
    """By how much two multipliers differ, in words."""
    difference = 100 * abs(first - second) / min(first, second)
    return f"they differ by {difference:.1f} %"


def predicted_world(config: Config) -> tuple[RobotParameters, Ground, Load]:
    """The robot with its centre of mass midway between the tracks, level ground, and the load from
    slope and pull. Prints a line if that isn't where its file has the centre of mass.
    """
    robot, ground = load_parameters(config.robot)
    if robot.com_y != 0:
        print(
            f"Note: com_y = {robot.com_y:g} m of {config.robot} is left out: the law is one for "
            "turns to both sides."
        )
    if config.ground is not None:
        ground = load_ground(config.ground)
    ground.require_even("the ground is even and level here, and --slope tilts it")
    options = ("half_gauge", "com_x", "sprocket_radius", "radius_error")
    values = {name: getattr(config, name) for name in options}
    given = {name: value for name, value in values.items() if value is not None}
    robot = replace(robot, com_y=0.0, **given)
    if config.contact_length is not None:
        robot = robot.with_contact_length(config.contact_length)
    weight = robot.mass * _GRAVITY
    load = Load(config.slope, config.uphill, config.pull / weight, config.pull_height)
    if ground.soil is not None:
        for name in ("friction", "friction_ratio", "shear"):
            value = getattr(config, name)
            require(value is None, name, value, "left out: the soil of the ground has its own")
        return robot, ground, load
    along = ground.along if config.friction is None else config.friction
    ratio = ground.across / ground.along if config.friction_ratio is None else config.friction_ratio
    shear = ground.shear if config.shear is None else config.shear
    return robot, Ground(along, ratio * along, shear=shear), load
