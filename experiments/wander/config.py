"""The options of `trackslip wander`."""

from dataclasses import dataclass, field, fields, replace
from pathlib import Path
from typing import Annotated, ClassVar, Literal

import tyro

from experiments.common.choices import SHIPPED
from experiments.common.options import (
    Excludes,
    Exclusion,
    Needs,
    NonNegative,
    Options,
    Positive,
    Whole,
    Within,
    default_is,
    refuse_changed,
)
from experiments.simulate.options import (
    MAX_DURATION,
    RADIUS_ERROR,
    DriveOptions,
    GroundOptions,
    PullOptions,
    Repeatable,
    RobotSource,
    Simulation,
    require_speed,
)
from sim.drive.drive import Drive
from sim.scanner.scanner import LaserScanner
from sim.wander.pose_source import SOURCES, PoseSource
from trackslip.errors import InvalidValueError

EXAMPLES = (
    ("two minutes of teleoperation, poses as from SLAM", "trackslip wander"),
    ("ten drives with GNSS", "trackslip wander --drives 10 --source gnss --out out/gnss"),
    ("a late clock and a jump", "trackslip wander --source.delay 0.15 --source.jumps 1 --source.jump-size 0.5"),
    ("a minute as a ROS 2 bag, with scans", "trackslip wander --duration 60 --source scanner --bag"),
    ("exactly by a law, to check an estimate", "trackslip wander --motion law --law.offset 0.04"),
)


MAX_DRIVES = 1000
_HEADER = ("drive", "rows", "poses", "distance [m]", "turned left [deg]", "right [deg]", "at rest")
_MOST_ROWS = 20  # of the table
_MIN_RATE, _MAX_RATE = 5.0, 1000.0  # of encoders and poses [Hz]
_MAX_ACCELERATION = 100.0  # [m/s^2]
_FLOAT = default_is("the source's", "FLOAT")
_COUNT = default_is("the source's", "INT")


@dataclass(frozen=True)
class SourceOptions:
    """The source of the poses, and properties that differ from the named one's."""

    source: Annotated[Literal["scanner", "mocap", "slam", "gnss", "odometry"], tyro.conf.arg(name="")] = "slam"
    """Poses as from the scanner, motion capture, SLAM, GNSS (no headings), or odometry that drifts."""
    rate: Annotated[float | None, _FLOAT] = None
    """Poses per second [Hz]."""
    position_noise: Annotated[float | None, _FLOAT] = None
    """Standard deviation of x and of y [m]."""
    heading_noise: Annotated[float | None, _FLOAT] = None
    """Standard deviation of the heading [rad]."""
    heading: Annotated[bool | None, tyro.conf.arg(help_behavior_hint="(default: the source's)")] = None
    """Measure headings, too."""
    delay: Annotated[float | None, _FLOAT] = None
    """Time stamp of a pose minus the encoders' of the same moment [s]."""
    jitter: Annotated[float | None, _FLOAT] = None
    """Standard deviation of the time stamps [s]."""
    outliers: Annotated[float | None, _FLOAT] = None
    """Share of the poses that are wrong [-]."""
    outlier_size: Annotated[float | None, _FLOAT] = None
    """Largest error of an outlier, in x and in y [m]."""
    outlier_turn: Annotated[float | None, _FLOAT] = None
    """Largest error of an outlier's heading [rad]."""
    dropouts: Annotated[float | None, _FLOAT] = None
    """Share of the poses that are missing, one by one [-]."""
    gaps: Annotated[int | None, _COUNT] = None
    """Number of stretches without poses."""
    gap_duration: Annotated[float | None, _FLOAT] = None
    """Length of each gap [s]."""
    jumps: Annotated[int | None, _COUNT] = None
    """Number of lasting jumps of the poses."""
    jump_size: Annotated[float | None, _FLOAT] = None
    """Length of each jump [m]."""
    jump_turn: Annotated[float | None, _FLOAT] = None
    """Turn of each jump, to a random side [rad]."""
    drift: Annotated[float | None, _FLOAT] = None
    """Drift of odometry, a random walk of the position: its error at the end over the distance driven [-]."""
    heading_drift: Annotated[float | None, _FLOAT] = None
    """Drift of odometry's heading, a random walk as well [rad/sqrt(m)]."""
    scale_error: Annotated[float | None, _FLOAT] = None
    """Relative error of all distances and turns of odometry [-]."""
    ahead: Annotated[float | None, _FLOAT] = None
    """Place of the sensor ahead of the robot's origin [m]."""
    left: Annotated[float | None, _FLOAT] = None
    """Place of the sensor to the left of the robot's origin [m]."""
    mounting: Annotated[float | None, _FLOAT] = None
    """Heading of the sensor in the robot, counter-clockwise [rad]."""

    def __post_init__(self) -> None:
        Within(0.1, _MAX_RATE, "Hz").check("rate", self.poses().rate)

    def poses(self) -> PoseSource:
        """The named source with the properties that are given here."""
        given = {option.name: getattr(self, option.name) for option in fields(PoseSource)}
        return replace(SOURCES[self.source], **{name: value for name, value in given.items() if value is not None})


@dataclass(frozen=True)
class LawOptions(Options):
    """Motion by a law of constant ICRs instead of MuJoCo's; needs --motion law."""

    offset: Annotated[float, Within(0, 10, "m")] = 0.045
    """D: distance of the ICRs outside the tracks [m]."""
    radius_error: Annotated[float, RADIUS_ERROR] = 0.0066
    """Relative error of the effective sprocket radius [-]."""
    slip: Literal["white", "lasting", "none"] = "white"
    """Slip that varies: 2 mm, 2 mm and 5 mrad per sqrt(m), or 2 % of each track's speed for 3 s, or none."""
    turning_centre: Annotated[float, Within(-10, 10, "m")] = 0.0
    """Place of the turning centre ahead of the robot's origin [m]."""
    drift: Annotated[float, Within(-10, 10, "s")] = 0.0
    """Outward drift in turns: lateral speed over forward speed times yaw rate [s]."""
    lag: Annotated[float, NonNegative(1.0, "s")] = 0.0
    """Time constant of the motion behind the belts [s]."""


@dataclass(frozen=True)
class Config(Repeatable):
    """Simulate teleoperated drives and log encoders and poses on separate clocks, as real robots do."""

    driving: Literal["random", "eights", "stop_and_go", "loop"] = "random"
    """Commands: a joystick moved at random, figure eights, constant speeds with stops, or laps of a square."""
    drives: Annotated[int, Whole(1, MAX_DRIVES)] = 1
    """Number of drives."""
    duration: Annotated[float, Positive(MAX_DURATION, "s")] = 120.0
    """Length of each drive [s]."""
    max_speed: float = 0.3
    """Largest speed of a track [m/s]."""
    acceleration: Annotated[float, Positive(_MAX_ACCELERATION, "m/s^2")] = 0.5
    """Largest acceleration of a track [m/s^2]."""
    encoder_rate: Annotated[float, Within(_MIN_RATE, _MAX_RATE, "Hz")] = 50.0
    """Readings of the encoders per second [Hz]."""
    source: SourceOptions = field(default_factory=SourceOptions)
    """The source of the poses, and properties that differ from the named one's."""
    motion: Literal["mujoco", "law"] = "mujoco"
    """Model that moves the robot: the simulated ground, or exactly a slip law."""
    law: LawOptions = field(default_factory=LawOptions)
    """Motion by a law of constant ICRs instead of MuJoCo's; needs --motion law."""
    robot: RobotSource = SHIPPED
    """Robot: a name, a file of parameters as written by calibrate, or of a model (MJCF, URDF) with its tracks."""
    radius_error: Annotated[float | None, RADIUS_ERROR, default_is("the robot's", "FLOAT")] = None
    """Relative error of the effective sprocket radius, real / nominal - 1 [-]."""
    drive: DriveOptions = field(default_factory=DriveOptions)
    """Properties of servo and motor that differ from the robot's."""
    ground: GroundOptions = field(default_factory=GroundOptions)
    """The ground, and properties that differ from the named one's."""
    pull: PullOptions = field(default_factory=PullOptions, metadata={"stored_unless": PullOptions()})
    """Load that the robot tows."""
    rrd: bool = False
    """Also write recordings for the rerun viewer to OUT/recordings."""
    bag: bool = False
    """Also write a ROS 2 bag of each drive to OUT/bags, with scans from --source scanner."""
    out: Path = Path("out/wander")
    """Folder for the results."""

    exclusions: ClassVar[tuple[Exclusion, ...]] = (
        Excludes(("ground", "pull", "radius_error"), "motion", ("law",)),
        Needs(("law",), "motion", ("law",)),
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.duration < 2 / self.encoder_rate:
            raise InvalidValueError("duration", self.duration, f"at least {2 / self.encoder_rate:g} s, two readings")
        if self.motion == "law":
            used = replace(DriveOptions(), top_speed=self.drive.top_speed, encoder_counts=self.drive.encoder_counts)
            refuse_changed("drive", self.drive, used, "with --motion law")
            return
        self.simulation()

    def check(self, drive: Drive) -> None:
        """Raise InvalidValueError for options that the robot's drive does not allow."""
        require_speed("max_speed", self.max_speed, drive.top_speed)
        periods = 1 / (self.encoder_rate * drive.period)
        if self.motion == "mujoco" and (abs(periods - round(periods)) > 1e-6 or periods < 0.5):
            allowed = f"a rate whose period is a multiple of drive.period = {drive.period} s"
            raise InvalidValueError("encoder_rate", self.encoder_rate, allowed)

    def simulation(self) -> Simulation:
        """The world to drive in."""
        shared = {
            option.name: getattr(self, option.name) for option in fields(Simulation) if hasattr(self, option.name)
        }
        return Simulation(**shared, scanner=LaserScanner(rate=self.encoder_rate))  # which is not used
