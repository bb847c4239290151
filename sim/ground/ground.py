"""The ground under the tracks: friction, shear, soft soil, slope, and patches and changes with
other friction.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Final

from sim.common.settings import build, read_named
from trackslip.arguments import checks_arguments
from trackslip.errors import (
    Checked,
    InvalidValueError,
    SettingsFileError,
    checked,
    one_of,
    require,
    require_at_most,
    require_non_negative,
    require_positive,
    require_within,
)
from trackslip.skid_theory.soil import Soil
from trackslip.skid_theory.soils import NAMED_SOILS

MAX_FRICTION: Final = 10.0
"""Largest friction coefficient [-]."""
MAX_SLOPE: Final = 1.5
"""Largest slope [rad]."""
MAX_SHEAR: Final = 0.2
"""Largest shear modulus [m]."""
UNLESS_ZERO: Final = {"stored_unless": 0.0}
"""Metadata for a field that is omitted from files if it is zero, so that older files stay
unchanged.
"""
_TURN: Final = 2 * math.pi
_MAX_PATCHES: Final = 10_000  # largest number of patches, and of changes, on a ground
_HARD: Final = 0.778 / 0.70  # ratio of the friction across to along on hard ground, as on stone


@dataclass(frozen=True)
class Patch:
    """An axis-aligned rectangle with its own friction, which acts on pads with their centres
    inside.
    """

    x: tuple[float, float]
    """Smallest and largest x in the world [m]; may be infinite."""
    y: tuple[float, float]
    """Smallest and largest y in the world [m]; may be infinite."""
    along: float
    """Friction coefficient along the track [-]."""
    across: float
    """Friction coefficient across the track [-]."""
    shear: float | None = field(default=None, metadata={"stored_unless": None})
    """Shear modulus; None for that of the surrounding ground [m]."""

    def __post_init__(self) -> None:
        _require_friction(self.along, self.across)
        require_non_negative("shear", self.shear or 0.0, MAX_SHEAR, "m")
        for name, pair in (("x", self.x), ("y", self.y)):
            require(
                len(pair) == 2 and pair[0] < pair[1], name, tuple(pair), "two ascending numbers"
            )


@dataclass(frozen=True)
class Change:
    """A change in the ground at some time, everywhere except on patches."""

    time: float
    """Time since the start of the run [s]."""
    along: float
    """Friction coefficient along the track [-]."""
    across: float
    """Friction coefficient across the track [-]."""
    shear: float | None = field(default=None, metadata={"stored_unless": None})
    """Shear modulus; None for no change in it [m]."""

    def __post_init__(self) -> None:
        _require_friction(self.along, self.across)
        require_non_negative("shear", self.shear or 0.0, MAX_SHEAR, "m")
        require_non_negative("time", self.time)


@checks_arguments
@dataclass(frozen=True)
class Ground(Checked):
    """A plane with friction along and across the tracks.

    Slip depends on the ratio of the two coefficients, not on their magnitude. The default is stone
    paving under tracks with treads that grip better sideways; its ratio is tuned so that the robot
    drives the radii observed in the paper.

    Ground with a shear modulus K gives way before it slides: an element of track that has moved by
    j over the ground since its touchdown exerts a share 1 - exp(-j / K) of the friction (Janosi and
    Hanamoto 1961). Slip then depends on slope, load and radius as well.

    Soft soil has friction and a shear modulus of its own, and robots sink in. `along` and `across`
    are the friction of such ground without cohesion and bulldozing.
    """

    along: float = checked(0.70, require_positive, MAX_FRICTION)
    """Friction coefficient along the track [-]."""
    across: float = checked(0.778, require_positive, MAX_FRICTION)
    """Friction coefficient across the track [-]."""
    slope: float = checked(0.0, require_non_negative, MAX_SLOPE, "rad")
    """Angle between the plane and the horizontal [rad]. Poses and scans are measured in the
    plane.
    """
    uphill: float = checked(0.0, require_within, -_TURN, _TURN, "rad")
    """Heading of a robot that drives straight up the slope [rad]."""
    patches: tuple[Patch, ...] = ()
    """Areas with other ground; where patches overlap, the last of them applies."""
    changes: tuple[Change, ...] = ()
    """Changes in the ground, in order of time."""
    shear: float = checked(0.0, require_non_negative, MAX_SHEAR, "m", **UNLESS_ZERO)
    """Shear modulus K; 0 for Coulomb friction [m]."""
    soil: Soil | None = field(default=None, metadata={"stored_unless": None})
    """Soft soil, which determines friction and shear; None for ground in which nothing sinks."""

    def __post_init__(self) -> None:
        if self.soil is not None:
            self._lay_soil(self.soil)
        super().__post_init__()
        for name in ("patches", "changes"):
            require_at_most(f"number of {name}", len(getattr(self, name)), _MAX_PATCHES)
        times = [change.time for change in self.changes]
        require(times == sorted(set(times)), "changes", times, "in ascending order, all different")

    def _lay_soil(self, soil: Soil) -> None:
        """Take friction and shear from the soil; raises InvalidValueError if they are given, or if
        the ground has patches or changes.
        """
        require(isinstance(soil, Soil), "soil", soil, "a Soil, or None for firm ground")
        require_positive("soil.friction_angle", soil.friction_angle)
        friction = math.tan(soil.friction_angle)
        for name, own in (("along", friction), ("across", friction), ("shear", soil.shear)):
            value = getattr(self, name)
            default = self.__dataclass_fields__[name].default
            require(value in (default, own), name, value, "left out: the soil has its own")
            object.__setattr__(self, name, own)
        for name in ("patches", "changes"):
            count = len(getattr(self, name))
            require(count == 0, name, count, "left out on soft soil, which is the same everywhere")

    def require_firm(self, reason: str) -> None:
        """Raise InvalidValueError, with the `reason`, for ground with soft soil."""
        if self.soil is not None:
            source = self.soil.source or "soft soil"
            raise InvalidValueError("ground.soil", source, f"left out: {reason}")

    def require_even(self, reason: str) -> None:
        """Raise InvalidValueError, with the `reason`, for ground with a slope, patches or
        changes.
        """
        for name in ("slope", "patches", "changes"):
            value = getattr(self, name)
            stated = value if name == "slope" else len(value)
            require(not value, f"ground.{name}", stated, f"left out: {reason}")

    @property
    def largest_shear(self) -> float:
        """Largest shear modulus of the ground, its patches and its changes [m]."""
        of_patches = [patch.shear or 0.0 for patch in self.patches]
        of_changes = [change.shear or 0.0 for change in self.changes]
        return max(self.shear, *of_patches, *of_changes, 0.0)

    def gravity(self, size: float) -> tuple[float, float, float]:
        """Gravity of magnitude `size` in the plane's frame: x and y in the plane, z along its
        normal [m/s^2].
        """
        downhill = size * math.sin(self.slope)
        return (
            -downhill * math.cos(self.uphill),
            -downhill * math.sin(self.uphill),
            -size * math.cos(self.slope),
        )


def _require_friction(along: float, across: float) -> None:
    for name, value in (("along", along), ("across", across)):
        require_positive(name, value, MAX_FRICTION)


def _hard(along: float) -> Ground:
    return Ground(along, round(along * _HARD, 3))


NAMED_GROUNDS: Final[dict[str, Ground]] = {
    # the paper's paving: along assumed; across tuned to slips and radii (trackslip calibrate)
    "stone": Ground(),
    "concrete": _hard(0.75),  # dry concrete: Noon
    "rubber": _hard(0.90),  # rubber matting: assumed
    "packed_soil": Ground(0.60, 0.75),  # assumed; ratio 1.25
    "gravel": Ground(0.35, 0.455),  # gravel and dirt road: Noon; ratio 1.3
    "wet": _hard(0.60),  # wet concrete: Noon
    # assumed: stone, 40 % stickier across after 20 s
    "sticky": Ground(changes=(Change(20.0, 0.70, 1.089),)),
    # firm sand, 31.1 degrees: Wong; ratio 1.25 and shear assumed
    "firm_sand": Ground(0.60, 0.75, shear=0.010),
    # dry sand, 28 degrees: Wong; ratio 1.3 and shear assumed
    "loose_sand": Ground(0.53, 0.689, shear=0.025),
    "clay": Ground(0.60, 0.75, shear=0.006),  # assumed, firm clay; ratio 1.25 and shear assumed
    # snow, 19.7 degrees: Wong; ratio 1.3 and shear assumed
    "snow": Ground(0.36, 0.468, shear=0.040),
    # for robots on wheels; the fits are in docs/reality.md
    # for tyres: assumed; ratio 1; a Warthog's log fits 0.76 and 0.99
    "asphalt": Ground(0.80, 0.80),
    "grass": Ground(0.50, 0.50),  # for tyres: assumed; ratio 1; a Warthog's log fits 0.50 and 0.95
    # ice, 0.10 to 0.15: Noon; ratio 1; a Warthog's log fits 0.12 and 1.08
    "ice": Ground(0.12, 0.12),
    # soft soils, with their sources in trackslip/skid_theory/soils.py
    **{name: Ground(soil=soil) for name, soil in NAMED_SOILS.items()},
}
"""Grounds by name, with sources for the friction along the track:

R. K. Noon, Engineering Analysis of Vehicular Accidents (1994), for tyres; J. Y. Wong, Theory of
Ground Vehicles (2008), for angles of friction, quoted second-hand.
"""


@checks_arguments
def load_ground(source: str) -> Ground:
    """Load a named ground, or a TOML file with fields of `Ground` and, as `base`, the named ground
    to be changed. A table `soil` has fields of `Soil`; what it leaves out is the base's.

    Raises InvalidValueError for any other source, SettingsFileError for an unreadable file or
    invalid fields.
    """
    if source in NAMED_GROUNDS:
        return NAMED_GROUNDS[source]
    table = read_named("ground", source, NAMED_GROUNDS)
    base = table.pop("base", "stone")
    if not isinstance(base, str) or base not in NAMED_GROUNDS:
        raise SettingsFileError(f"{source}: base = {base!r}: must be {one_of(NAMED_GROUNDS, base)}")
    ground = NAMED_GROUNDS[base]
    if "soil" in table:
        table["soil"] = _soil_table(table["soil"], ground.soil, source)
        ground = Ground()
    return build(Ground, table, source, ground)


def _soil_table(given: Any, base: Soil | None, source: str) -> Any:
    """The fields of a soil, where `base` supplies those that are not given."""
    if base is None or not isinstance(given, Mapping):
        return given
    origin = f"{base.source}, changed in {source}"
    assumed = tuple(name for name in base.assumed if name not in given)
    return {**vars(base), "source": origin, "assumed": assumed, **given}
