"""Tracked robots: a model, the running gear on its bodies, and what holds its joints."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

import numpy as np

from sim.motors.motor import Drive
from sim.robot.gear import (
    BOTH,
    LEFT,
    RIGHT,
    SAME_HEIGHT,
    FlipperMotor,
    RunningGear,
    Wheels,
    levelled,
)
from sim.robot.joint_rules import JointRule
from sim.robot.parameters import PATCH_LENGTH, TRACKS, WHEELS
from sim.robot.urdf import read_model
from sim.tracks.hull import Hull
from trackslip.arguments import checks_arguments
from trackslip.errors import (
    Checked,
    checked,
    require,
    require_finite,
    require_non_negative,
    require_positive,
)

# largest upward component of the normal of a level run: 1.1 degrees off level [-]
_LEVEL: Final = -0.9998


@checks_arguments
@dataclass(frozen=True)
class Flipper(Checked):
    """A hinged body with one track, which runs together with the chassis' track on the same
    side.
    """

    body: str
    """Name of the body."""
    side: str
    """Side of the chassis, left or right, whose track drives the flipper's belt."""
    hull: Wheels
    """Wheels (x, z, radius) in the body's frame [m]; the belt is their convex hull."""
    y: float = 0.0
    """Lateral position of the track in the body's frame, to the left [m]."""
    width: float = checked(0.05, require_positive)
    """Width of the belt [m]."""
    stiffness: float = checked(250.0, require_positive)
    """Stiffness of the motor that a hinge without a motor gets [N m/rad]."""
    damping: float = checked(15.0, require_non_negative)
    """Damping of the added motor [N m s/rad]."""
    torque: float = checked(90.0, require_positive)
    """Largest torque of the added motor, unless the model limits the hinge's torque [N m]."""
    lines: int = 1
    """Lines of contact across the belt's width, 1 or 3; with 1 line, the width is only drawn."""

    def __post_init__(self) -> None:
        Hull.from_wheels(self.hull)
        require(self.side in (LEFT, RIGHT), "side", self.side, "left or right")
        require(abs(self.y) <= 10, "y", self.y, "from -10 to 10 m")
        super().__post_init__()

    @property
    def gear(self) -> RunningGear:
        """The flipper as an entry of the list of tracks."""
        motor = FlipperMotor(self.stiffness, self.damping, self.torque)
        return RunningGear(
            self.body,
            self.side,
            self.y,
            hull=self.hull,
            width=self.width,
            lines=self.lines,
            flipper=motor,
            origin="[[flippers]]",
        )


@checks_arguments
@dataclass(frozen=True)
class TrackedRobot:
    """A model, its running gear, and what holds its joints. A robot file has these fields, and a
    table `tracks` for each entry of the running gear.

    A robot with one pair of tracks on its chassis needs no table `tracks`: `half_gauge`, `hull`,
    `contact`, `patch_length`, `width` and `lines` describe the pair, and a table `flippers` each
    flipper. `gear` translates both to one list. With tables `tracks`, `half_gauge`, `offset` and
    `hull` are derived from the list.
    """

    model: Path
    """MJCF or URDF file; in a robot file, its path is relative to the robot file."""
    half_gauge: float = 0.0
    """Half the distance between the left and right tracks [m]."""
    hull: Wheels = ()
    """Wheels (x, z, radius) on one side of the chassis, in its frame [m]; the belt is their convex
    hull.
    """
    body: str = ""
    """Name of the chassis; by default the only body directly in the model's world."""
    contact: str = TRACKS
    """What touches the ground: "tracks", or "wheels" that turn at one speed per side."""
    patch_length: float = PATCH_LENGTH
    """Length of a wheel's contact with level ground [m]."""
    width: float = 0.08
    """Width of the chassis' belts or tyres [m]."""
    lines: int = 1
    """Lines of contact across that width: 1 if the width is only drawn, or 3 to resist tipping over
    the edges.
    """
    flippers: tuple[Flipper, ...] = ()
    """Flippers, in any order."""
    wheels: tuple[str, ...] = ()
    """Links that tracks replace: they don't collide, and their joints are locked, except those of
    flippers. In a robot file, "replace" stands for the flippers and all round links that turn
    endlessly about y. `half_gauge`, `offset` and `hull` are read from these wheels unless they are
    given.
    """
    packages: tuple[Path, ...] = ()
    """Folders of the packages in package://NAME/FILE, or their parent folders, searched before the
    folders above the model; other files of the model may lie in them, too. In a robot file, their
    paths are relative to the robot file.
    """
    key: str = field(default="", metadata={"stored_unless": ""})
    """MJCF keyframe from which joints and motors start; by default they start at 0, or as near to
    it as their limits allow.
    """
    name: str = "robot"
    """Name of the robot; by default the robot file's name without .toml."""
    drive: Drive | None = field(default=None, metadata={"stored_unless": None})
    """Servos and motors; None for motors of unlimited torque."""
    offset: float = field(default=0.0, metadata={"stored_unless": 0.0})
    """Distance of the middle between the tracks to the left of the chassis' frame [m]."""
    tracks: tuple[RunningGear, ...] = field(default=(), metadata={"stored_unless": ()})
    """The running gear without the table `flippers`; empty for one pair of tracks."""
    joints: tuple[JointRule, ...] = field(default=(), metadata={"stored_unless": ()})
    """What holds or moves the joints. In a robot file, a table of states by name."""
    origin: str = field(default="", compare=False, metadata={"stored_unless": ""})
    """Where `half_gauge`, `offset` and `hull` come from."""

    def __post_init__(self) -> None:
        require_positive("width", self.width)
        require_finite("offset", self.offset)
        flippers = [(each.body, each.side, each.y) for each in self.flippers]
        bodies = tuple(body for body, _, _ in flippers)
        allowed = "on bodies that are all different, or at different places"
        require(len(set(flippers)) == len(flippers), "flippers", bodies, allowed)
        if self.tracks:
            return
        if not self.hull and not self.half_gauge:
            allowed = "given, unless `wheels`, [[tracks]] or [[flippers]] tell it"
            require(self.flippers, "half_gauge, hull", None, allowed)
            return  # a robot that stands on its flippers
        Hull.from_wheels(self.hull)
        require_positive("half_gauge", self.half_gauge)
        self._pair.track(levelled(self.hull), "accurate", (1.0, 1.0))

    @property
    def gear(self) -> tuple[RunningGear, ...]:
        """The running gear, as one list: the chassis' tracks, then the flippers."""
        flippers = tuple(flipper.gear for flipper in self.flippers)
        if self.tracks:
            return (*self.tracks, *flippers)
        if not self.hull:
            return flippers
        return (self._pair, *flippers)

    @property
    def _pair(self) -> RunningGear:
        """The pair of tracks, or rows of wheels, on the chassis."""
        half = self.half_gauge
        places = (self.offset + half, self.offset - half)
        return RunningGear(
            sides=BOTH,
            y=places if self.offset else half,
            hull=self.hull,
            contact=self.contact,
            patch_length=self.patch_length,
            width=self.width,
            lines=self.lines,
            origin=self.origin,
        )

    @property
    def gear_bodies(self) -> tuple[str, ...]:
        """Names of the bodies other than the chassis that carry running gear."""
        names = (gear.body for gear in self.gear if gear.body not in ("", self.body))
        return tuple(dict.fromkeys(names))

    @property
    def flipper_bodies(self) -> tuple[str, ...]:
        """Names of the bodies in the table `flippers`."""
        return tuple(dict.fromkeys(flipper.body for flipper in self.flippers))

    @property
    def contact_length(self) -> float:
        """Length of the contact with level ground, from rear to front [m]."""
        patch = self.patch_length if self.contact == WHEELS else 0.0
        return max(self.standing) - min(self.standing) + patch

    @property
    def middle(self) -> float:
        """Middle of the contact with level ground, ahead of the chassis' frame [m]."""
        ends = self.standing
        return float(np.mean(ends if self.contact == WHEELS else [min(ends), max(ends)]))

    @property
    def standing(self) -> list[float]:
        """Axles of the wheels, or ends of the runs, that stand on level ground, ahead of the
        chassis' frame [m].
        """
        level = levelled(self.hull)
        if self.contact == WHEELS:
            return [x for x, z, radius in level if z - radius < self.lowest + SAME_HEIGHT]
        runs = [run for run in Hull.from_wheels(level).runs if run.outwards[1] < _LEVEL]
        return [float(end[0]) for run in runs for end in (run.start, run.end)] or [0.0]

    @property
    def sprocket_radius(self) -> float:
        """Radius of the largest wheel, which is assumed to be the sprocket [m]."""
        return max(radius for _, _, radius in self.hull)

    @property
    def lowest(self) -> float:
        """Height of the lowest point of the chassis' tracks in the chassis' frame [m]."""
        return min(z - r for _, z, r in self.hull)

    def spec(self) -> Any:
        """The model as a `mujoco.MjSpec`; raises what `read_model` raises."""
        return read_model(self.model, self.wheels, self.packages)
