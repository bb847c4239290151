"""The options of `trackslip wander`."""

from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Final, Literal

import tyro

from experiments.common.options import Positive, Whole, Within, default_is, refuse_changed
from experiments.simulate.options import (
    MAX_DURATION,
    Simulation,
    UsualSpeed,
    changed,
    require_speed,
    speed_or_usual,
)
from sim.motors.motor import Drive
from sim.scanner.scanner import LaserScanner
from sim.wander.pose_sensor import POSE_SENSORS, PoseSensor
from trackslip.errors import InvalidValueError

EXAMPLES: Final = (
    ("two minutes of teleoperation, poses as from SLAM", "trackslip wander"),
    (
        "a late clock and a jump",
        "trackslip wander --source.delay 0.15 --source.jumps 1 --out out/late",
    ),
    (
        "a minute as a ROS 2 bag, with scans",
        "trackslip wander --duration 60 --source scanner --bag --out out/bag",
    ),
)
ESSENTIAL: Final = (
    "driving",
    "drives",
    "duration",
    "source.source",
    "source.delay",
    "source.ahead",
    "robot",
    "ground.source",
    "seed",
    "bag",
    "rrd",
    "out",
    "overwrite",
)
# limits for the rate of the encoders [Hz]
_MIN_RATE: Final = 5.0
_MAX_RATE: Final = 1000.0
_FLOAT: Final = default_is("the source's", "FLOAT")
_COUNT: Final = default_is("the source's", "INT")


@dataclass(frozen=True)
class SourceOptions:
    """The source of the poses, and properties that differ from the named source."""

    source: Annotated[
        Literal["scanner", "mocap", "slam", "gnss", "odometry"], tyro.conf.arg(name="")
    ] = "slam"
    """Poses like those from the scanner, motion capture, SLAM, GNSS (no headings), or odometry that
    drifts.
    """
    rate: Annotated[float | None, _FLOAT] = None
    """Poses per second [Hz]."""
    position_noise: Annotated[float | None, _FLOAT] = None
    """Standard deviation of the noise in x and in y [m]."""
    heading_noise: Annotated[float | None, _FLOAT] = None
    """Standard deviation of the noise in the heading [rad]."""
    heading: Annotated[bool | None, tyro.conf.arg(help_behavior_hint="(default: the source's)")] = (
        None
    )
    """Also measure headings."""
    delay: Annotated[float | None, _FLOAT] = None
    """Time stamp of a pose minus the encoders' time stamp at the same moment [s]."""
    jitter: Annotated[float | None, _FLOAT] = None
    """Standard deviation of the noise in the time stamps [s]."""
    outliers: Annotated[float | None, _FLOAT] = None
    """Share of the poses that are wrong, by up to 0.5 m and 0.5 rad [-]."""
    gaps: Annotated[int | None, _COUNT] = None
    """Number of stretches without poses."""
    gap_duration: Annotated[float | None, _FLOAT] = None
    """Length of each gap [s]."""
    jumps: Annotated[int | None, _COUNT] = None
    """Number of lasting jumps in the poses."""
    jump_size: Annotated[float | None, _FLOAT] = None
    """Length of each jump [m]."""
    drift: Annotated[float | None, _FLOAT] = None
    """Random walk of odometry: final position error over the distance driven [-]."""
    ahead: Annotated[float | None, _FLOAT] = None
    """Position of the sensor ahead of the robot's origin [m]."""
    left: Annotated[float | None, _FLOAT] = None
    """Position of the sensor to the left of the robot's origin [m]."""
    mounting: Annotated[float | None, _FLOAT] = None
    """Heading of the sensor relative to the robot, counter-clockwise [rad]."""

    def __post_init__(self) -> None:
        Within(0.1, _MAX_RATE, "Hz").check("rate", self.poses().rate)

        if not self.poses().gaps:
            refuse_changed("gap_duration", self.gap_duration, None, "without gaps")
        if not self.poses().jumps:
            refuse_changed("jump_size", self.jump_size, None, "without jumps")
        if not self.poses().heading:
            for name in ("heading_noise", "mounting"):
                refuse_changed(name, getattr(self, name), None, "without headings")

    def poses(self) -> PoseSensor:
        """The named source with the properties that are given here."""
        return changed(POSE_SENSORS[self.source], self)


@dataclass(frozen=True)
class Config(Simulation):
    """Simulate teleoperated drives and log encoders and poses on separate clocks, as real robots
    do.
    """

    driving: Literal["random", "eights", "stop_and_go", "loop"] = "random"
    """Commands: a joystick moved at random, figure eights, constant speeds with stops, or laps of a
    square.
    """
    drives: Annotated[int, Whole(1, 1000)] = 1
    """Number of drives."""
    duration: Annotated[float, Within(1, MAX_DURATION, "s")] = 120.0
    """Length of each drive [s]."""
    max_speed: UsualSpeed = None
    """Largest speed of a track [m/s]."""
    acceleration: Annotated[float, Positive(100.0, "m/s^2")] = 0.5
    """Largest acceleration of a track [m/s^2]."""
    encoder_rate: Annotated[float, Within(_MIN_RATE, _MAX_RATE, "Hz")] = 50.0
    """Encoder readings per second [Hz]."""
    source: SourceOptions = field(default_factory=SourceOptions)
    """The source of the poses, and properties that differ from the named source."""
    bag: bool = False
    """Also write a ROS 2 bag of each drive to OUT/bags, with scans from --source scanner."""
    out: Path = Path("out/wander")
    """Folder for the results."""
    pdf: bool = False
    """Also write the figures as PDF."""
    scanner: Annotated[LaserScanner, tyro.conf.Fixed, tyro.conf.Suppress] = field(
        default_factory=LaserScanner
    )
    """The scanner for --source scanner, which scans at the rate of the poses."""
    obstacles: Annotated[str | None, tyro.conf.Fixed, tyro.conf.Suppress] = None
    """None, because only the plate is scanned."""

    def fastest(self, drive: Drive) -> float:
        """Largest speed of a track of a robot with this drive [m/s]."""
        return speed_or_usual(self.max_speed, drive.top_speed)

    def check(self, drive: Drive) -> None:
        """Raise InvalidValueError for options that the robot's drive does not allow."""
        require_speed("max_speed", self.fastest(drive), drive.top_speed)
        periods = 1 / (self.encoder_rate * drive.period)
        if abs(periods - round(periods)) > 1e-6 or periods < 0.5:
            allowed = f"a rate whose period is a multiple of drive.period = {drive.period} s"
            raise InvalidValueError("encoder_rate", self.encoder_rate, allowed)
