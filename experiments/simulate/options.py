"""The options that describe the simulated world, shared by every command that simulates."""

from dataclasses import dataclass, field, fields, is_dataclass, replace
from pathlib import Path
from typing import Annotated, Any, ClassVar, Final, Literal, TypeVar

import tyro

from experiments.common.choices import GROUNDS, ROBOTS, SHIPPED
from experiments.common.options import (
    Excludes,
    Exclusion,
    ResultsOptions,
    Whole,
    Within,
    default_is,
    refuse_changed,
)
from sim.ground.ground import Ground
from sim.ground.pull import MAX_FORCE, Pull
from sim.motors.motor import Drive, Motor, or_tireless
from sim.robot.parameters import MAX_RADIUS_ERROR
from sim.runs.loop import MEASURED, Delay, WhenLost
from sim.scanner.scanner import LaserScanner
from trackslip.errors import InvalidValueError, checked, require_non_negative, require_positive

T = TypeVar("T")
Localization = Literal["plate", "line"]
Motion = Literal["paper", "arc", "bundle"]
Method = Annotated[
    Motion | None, default_is("the most accurate method the run allows", "{paper,arc,bundle}")
]
"""Method to estimate a twist from a run; None if the user chooses none."""
RobotSource = Annotated[str, tyro.conf.arg(metavar=ROBOTS)]
"""A robot's name or file."""
IDENTIFIED: Final = ("exponential", "icr", "icr_radius")
"""Identified laws that `reproduce` uses for compensation, besides no law and the published law."""

MAX_THREADS: Final = 1024
MAX_JOBS: Final = 1024
MAX_SEED: Final = 2**63 - 1  # largest integer in a Parquet file
MAX_PREVIEW: Final = 1.0  # [s]
MAX_DELAY: Final = 1.0  # of a command [s]
MIN_DURATION: Final = 4.0
"""Shortest run; a shorter one has no steady part to average over [s]."""
MAX_DURATION: Final = 3600.0
"""Longest run [s]."""
_MIN_SPEED: Final = 1e-3  # [m/s]
_ROUNDING: Final = 1e-6  # tolerance on numbers of servo periods
USUAL_SPEED: Final = 0.3
"""Speed of a robot that nobody asks for another one [m/s]."""
UsualSpeed = Annotated[
    float | None, default_is(f"{USUAL_SPEED}, or the robot's top speed if that is lower", "FLOAT")
]
"""An option whose default is `speed_or_usual`."""
MIN_RADIUS: Final = 1e-3  # [m]
MAX_RADIUS: Final = 1000.0  # [m]
MIN_FRICTION_RATIO: Final = 0.01  # friction across the track over friction along it [-]
MAX_COORDINATE: Final = 100.0  # largest coordinate of a start [m]
RADIUS_ERROR: Final = Within(-MAX_RADIUS_ERROR, MAX_RADIUS_ERROR)


@dataclass(frozen=True)
class GroundOptions:
    """The ground, and properties that differ from the named ground."""

    source: Annotated[
        str | None,
        tyro.conf.arg(
            name="", metavar=GROUNDS, help_behavior_hint="(default: the robot's, else stone)"
        ),
    ] = None
    """Ground to drive on."""
    along: Annotated[float | None, default_is("the ground's", "FLOAT")] = None
    """Friction coefficient along the track [-]."""
    across: Annotated[float | None, default_is("the ground's", "FLOAT")] = None
    """Friction coefficient across the track [-]."""
    slope: Annotated[float | None, default_is("the ground's", "FLOAT")] = None
    """Angle of the ground to the horizontal [rad]."""
    uphill: Annotated[float | None, default_is("the ground's", "FLOAT")] = None
    """Heading of a robot that drives straight up the slope [rad]."""
    shear: Annotated[float | None, default_is("the ground's", "FLOAT")] = field(
        default=None, metadata={"stored_unless": None}
    )
    """Shear modulus of ground that gives way before it slides, 0 for Coulomb friction [m]."""

    def __post_init__(self) -> None:
        changed(Ground(), self)

    def changed(self, ground: Ground) -> Ground:
        """`ground` with the properties that are given here; raises InvalidValueError for `uphill`
        on level ground, unless the slope is given, too, as in a sweep over slopes.
        """
        result = changed(ground, self)
        if self.uphill is not None and self.slope is None and result.slope == 0:
            raise InvalidValueError("ground.uphill", self.uphill, "left out on level ground")
        return result


OwnNumber = Annotated[float | None, default_is("the robot's", "FLOAT")]
"""An option whose default is the value in the robot's drive."""


@dataclass(frozen=True)
class MotorOptions:
    """Properties of the motor that differ from the robot's.

    There is no voltage: speed and torque are stated at full voltage, so that it cancels out.
    """

    gear: OwnNumber = None
    """Gear ratio, motor speed over sprocket speed [-]."""
    no_load_speed: OwnNumber = None
    """No-load speed of the motor at full voltage [rad/s]."""
    stall_torque: OwnNumber = None
    """Stall torque of the motor at full voltage [N m]."""
    rotor_inertia: OwnNumber = None
    """Moment of inertia of the motor, including the gear [kg m^2]."""
    friction: OwnNumber = None
    """Friction torque of the gear, at the sprocket [N m]."""


@dataclass(frozen=True)
class DriveOptions:
    """Properties of servo and motor that differ from the robot's."""

    lag: OwnNumber = None
    """Time constant of the speed controller [s]."""
    top_speed: OwnNumber = None
    """Largest speed of a track [m/s]."""
    torque_limit: OwnNumber = None
    """Largest torque of the motor at the sprocket, limited by the amplifier's current [N m]."""
    encoder_counts: Annotated[int | None, default_is("the robot's", "INT")] = None
    """Encoder counts per revolution of the sprocket (motor encoder times gear)."""
    period: OwnNumber = None
    """Sampling period of the servo [s]."""
    motor: MotorOptions = field(default_factory=MotorOptions)
    """Properties of the motor that differ from the robot's."""

    def changed(self, own: Drive | None) -> Drive:
        """A robot's `own` drive with the properties that are given here.

        A robot without motors gets unlimited ones, or motors like the shipped robot's if properties
        of motors are given.
        """
        drive = or_tireless(own)
        if own is None and self.motor != MotorOptions():
            drive = replace(drive, motor=Motor())
        return changed(drive, self, "drive.")


def changed(base: T, options: object, prefix: str = "") -> T:
    """`base` with the fields that `options` set; raises InvalidValueError with `prefix` before the
    field's name.
    """
    given: dict[str, Any] = {}
    for name in (f.name for f in fields(base)):  # type: ignore[arg-type]
        value = getattr(options, name, None)
        if value is not None:
            own = getattr(base, name)
            given[name] = changed(own, value, f"{prefix}{name}.") if is_dataclass(value) else value
    try:
        return replace(base, **given)  # type: ignore[type-var]
    except InvalidValueError as error:
        raise InvalidValueError(f"{prefix}{error.field}", error.value, error.allowed) from error


@dataclass(frozen=True)
class PullOptions(Pull):
    """Load that the robot tows."""

    force: Annotated[float, tyro.conf.arg(name="")] = checked(
        0.0, require_non_negative, MAX_FORCE, "N"
    )
    """Drawbar force, backwards along the robot [N]."""


@dataclass(frozen=True)
class Repeatable(ResultsOptions):
    """The options of every command that simulates."""

    seed: Annotated[int, Whole(0, MAX_SEED)] = 0
    """Seed for all random numbers."""
    threads: Annotated[int, Whole(0, MAX_THREADS)] = 0
    """Number of worker threads, 0 for one per processor; the results don't depend on it."""


@dataclass(frozen=True)
class Equipment(ResultsOptions):
    """The robot, its scanner and the field, without the ground."""

    robot: RobotSource = SHIPPED
    """Robot: a name, a parameter file as written by calibrate, or a model file (MJCF, URDF) with
    its tracks.
    """
    radius_error: Annotated[float | None, RADIUS_ERROR, default_is("the robot's", "FLOAT")] = None
    """Relative error of the effective sprocket radius, real / nominal - 1 [-]."""
    drive: DriveOptions = field(default_factory=DriveOptions)
    """Properties of servo and motor that differ from the robot's."""
    scanner: LaserScanner = field(default_factory=LaserScanner)
    """A line scanner modelled on the SICK LMS 200; the paper doesn't name its scanner."""
    obstacles: Annotated[str | None, default_is("nothing", "NAME|FILE")] = None
    """Objects that the scanner sees besides the plate: posts, room, occluded, or a .toml file."""
    pull: PullOptions = field(
        default_factory=PullOptions, metadata={"stored_unless": PullOptions()}
    )
    """Load that the robot tows."""

    def require_load(self) -> None:
        """Raise InvalidValueError for properties of a load that pulls with no force."""
        if self.pull.force == 0:
            refuse_changed("pull", self.pull, PullOptions(), "without --pull")

    def check(self, drive: Drive) -> None:
        """Raise InvalidValueError for options that the robot's drive does not allow."""
        scan_periods = self.scanner.period / drive.period
        if abs(scan_periods - round(scan_periods)) > _ROUNDING or scan_periods < 0.5:
            allowed = f"a rate whose period is a multiple of drive.period = {drive.period} s"
            raise InvalidValueError("scanner.rate", self.scanner.rate, allowed)


WITHOUT_SCANS: Final = Excludes(
    (
        *("scanner.field_of_view", "scanner.resolution", "scanner.noise", "scanner.max_range"),
        *("scanner.dropout", "scanner.quantisation", "scanner.range_bias", "obstacles"),
        "when_lost",
    ),
    "localization",
    ("truth",),
)
"""With the true pose nothing is measured, but commands still have the period of the scans."""


@dataclass(frozen=True)
class ClosedLoopOptions(Equipment):
    """Options that closed-loop runs have in common, including their equipment."""

    localization: Literal["plate", "line", "truth"] = "plate"
    """Source of the controllers' poses: scans, by the plate or line method, or the true pose
    (truth).
    """
    preview: Annotated[float, Within(0, MAX_PREVIEW, "s")] = 0.0
    """Time by which controllers look ahead on the path; 0.075 s compensates for the lag of servo
    and sampling [s].
    """
    command_delay: Annotated[Delay, tyro.conf.arg(metavar="FLOAT|measured")] = 0.0
    """Time until a command takes effect, a multiple of drive.period, or measured for the computing
    time of each step [s].
    """
    when_lost: WhenLost = "drive"
    """What to do after 0.5 s without a valid pose: drive on by the encoders, slow down to half the
    path's speed, or stop.
    """
    laws: Annotated[Path | None, default_is("the laws shipped with trackslip", "PATH")] = None
    """Identified laws: a summary.json, or a folder that contains one."""

    exclusions: ClassVar[tuple[Exclusion, ...]] = (WITHOUT_SCANS,)

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.command_delay != MEASURED:
            Within(0, MAX_DELAY, "s").check("command_delay", self.command_delay)

    def check(self, drive: Drive) -> None:
        """Raise InvalidValueError for options that the robot's drive does not allow."""
        super().check(drive)
        if isinstance(self.command_delay, str):
            return
        periods = self.command_delay / drive.period
        if abs(periods - round(periods)) > _ROUNDING:
            allowed = f"a multiple of drive.period = {drive.period} s"
            raise InvalidValueError("command_delay", self.command_delay, allowed)


@dataclass(frozen=True)
class Simulation(Repeatable, Equipment):
    """Options of the simulated world, which are the same for every command that drives."""

    ground: GroundOptions = field(default_factory=GroundOptions)
    """The ground, and properties that differ from the named ground."""
    rrd: bool = False
    """Also write recordings for the rerun viewer to OUT/recordings."""


def speed_or_usual(asked: float | None, top_speed: float) -> float:
    """The speed `asked` for or, if none is, the usual one of `USUAL_SPEED`, or the robot's top
    speed if that is lower [m/s].
    """
    return min(USUAL_SPEED, top_speed) if asked is None else asked


def require_speed(name: str, speed: float, top_speed: float) -> None:
    """Raise InvalidValueError unless a speed is positive, not almost zero, and at most `top_speed`
    [m/s].
    """
    require_positive(name, speed)
    if speed > top_speed:
        raise InvalidValueError(name, speed, f"at most drive.top_speed = {top_speed} m/s")
    if speed < _MIN_SPEED:
        raise InvalidValueError(name, speed, f"at least {_MIN_SPEED:g} m/s")
