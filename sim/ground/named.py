"""Grounds by name, or from a TOML file.

The source of a named ground, if any, is that of the friction along the track; that across is assumed. Slip depends
only on the ratio across / along: 0.778 / 0.70 for hard ground, on which treads grip slightly better sideways, more on
loose ground, which the track must push aside, and 1 on ice.

Shear moduli are assumed, of the order that terramechanics gives for such grounds: about a centimetre for firm sand, two
to five for loose sand and snow, and less for clay.
"""

from __future__ import annotations

from dataclasses import dataclass

from sim.ground.ground import Change, Ground
from sim.toml_file import build, read_named
from trackslip.errors import SettingsFileError

_HARD = 0.778 / 0.70
_NOON = "R. K. Noon, Engineering Analysis of Vehicular Accidents (1994), of tyres"
_WONG = "angle of friction after J. Y. Wong, Theory of Ground Vehicles (2008), read second-hand"


@dataclass(frozen=True)
class NamedGround:
    """A ground and the source of its numbers."""

    ground: Ground
    source: str
    """Source of the friction along the track; that across is assumed, unless stated otherwise."""


def _hard(along: float) -> Ground:
    return Ground(along, round(along * _HARD, 3))


NAMED_GROUNDS: dict[str, NamedGround] = {
    "stone": NamedGround(
        Ground(), "the paper's paving: along assumed; across tuned to its slips and radii (trackslip calibrate)"
    ),
    "concrete": NamedGround(_hard(0.75), f"dry concrete: {_NOON}"),
    "rubber": NamedGround(_hard(0.90), "rubber matting: assumed"),
    "packed_soil": NamedGround(Ground(0.60, 0.75), "assumed; ratio 1.25"),
    "gravel": NamedGround(Ground(0.35, 0.455), f"gravel and dirt road: {_NOON}; ratio 1.3"),
    "wet": NamedGround(_hard(0.60), f"wet concrete: {_NOON}"),
    "sticky": NamedGround(
        Ground(changes=(Change(20.0, 0.70, 1.089),)), "assumed: stone that grows 40 % stickier across after 20 s"
    ),
    "firm_sand": NamedGround(
        Ground(0.60, 0.75, shear=0.010), f"firm sand, 31.1°: {_WONG}; ratio 1.25 and shear assumed"
    ),
    "loose_sand": NamedGround(Ground(0.53, 0.689, shear=0.025), f"dry sand, 28°: {_WONG}; ratio 1.3 and shear assumed"),
    "clay": NamedGround(Ground(0.60, 0.75, shear=0.006), "assumed, firm clay; ratio 1.25 and shear assumed"),
    "snow": NamedGround(Ground(0.36, 0.468, shear=0.040), f"snow, 19.7°: {_WONG}; ratio 1.3 and shear assumed"),
    # for robots on wheels; docs/reality.md has the fits
    "asphalt": NamedGround(Ground(0.80, 0.80), "of tyres: assumed; ratio 1; a Warthog's log fits 0.76 and 0.99"),
    "grass": NamedGround(Ground(0.50, 0.50), "of tyres: assumed; ratio 1; a Warthog's log fits 0.50 and 0.95"),
    "ice": NamedGround(Ground(0.12, 0.12), f"ice, 0.10 to 0.15: {_NOON}; ratio 1; a Warthog's log fits 0.12 and 1.08"),
}


def load_ground(source: str) -> Ground:
    """Load a named ground, or a TOML file with fields of `Ground` and, as `base`, the named ground that they change.

    Raises InvalidValueError for any other source, SettingsFileError for an unreadable file and invalid fields.
    """
    if source in NAMED_GROUNDS:
        return NAMED_GROUNDS[source].ground
    table = read_named("ground", source, NAMED_GROUNDS)
    base = table.pop("base", "stone")
    if not isinstance(base, str) or base not in NAMED_GROUNDS:
        raise SettingsFileError(f"{source}: base = {base!r}: must be one of {', '.join(NAMED_GROUNDS)}")
    return build(Ground, table, source, NAMED_GROUNDS[base].ground)
