"""Grounds by name, or from a TOML file.

The source of a named ground, if any, is that of the friction along the track; that across is assumed. Slip depends
only on the ratio across / along: 0.778 / 0.70 for hard ground, on which treads grip slightly better sideways, more on
loose ground, which the track must push aside, and 1 on ice.

Shear moduli are assumed, of the order that terramechanics gives for such grounds: about a centimetre for firm sand, two
to five for loose sand and snow, and less for clay.
"""

from __future__ import annotations

from sim.ground.ground import Change, Ground
from sim.settings import build, read_named
from trackslip.errors import SettingsFileError

_HARD = 0.778 / 0.70


def _hard(along: float) -> Ground:
    return Ground(along, round(along * _HARD, 3))


NAMED_GROUNDS: dict[str, Ground] = {
    "stone": Ground(),  # the paper's paving: along assumed; across tuned to its slips and radii (trackslip calibrate)
    "concrete": _hard(0.75),  # dry concrete: Noon
    "rubber": _hard(0.90),  # rubber matting: assumed
    "packed_soil": Ground(0.60, 0.75),  # assumed; ratio 1.25
    "gravel": Ground(0.35, 0.455),  # gravel and dirt road: Noon; ratio 1.3
    "wet": _hard(0.60),  # wet concrete: Noon
    "sticky": Ground(changes=(Change(20.0, 0.70, 1.089),)),  # assumed: stone that grows 40 % stickier across after 20 s
    "firm_sand": Ground(0.60, 0.75, shear=0.010),  # firm sand, 31.1 degrees: Wong; ratio 1.25 and shear assumed
    "loose_sand": Ground(0.53, 0.689, shear=0.025),  # dry sand, 28 degrees: Wong; ratio 1.3 and shear assumed
    "clay": Ground(0.60, 0.75, shear=0.006),  # assumed, firm clay; ratio 1.25 and shear assumed
    "snow": Ground(0.36, 0.468, shear=0.040),  # snow, 19.7 degrees: Wong; ratio 1.3 and shear assumed
    # for robots on wheels; docs/reality.md has the fits
    "asphalt": Ground(0.80, 0.80),  # of tyres: assumed; ratio 1; a Warthog's log fits 0.76 and 0.99
    "grass": Ground(0.50, 0.50),  # of tyres: assumed; ratio 1; a Warthog's log fits 0.50 and 0.95
    "ice": Ground(0.12, 0.12),  # ice, 0.10 to 0.15: Noon; ratio 1; a Warthog's log fits 0.12 and 1.08
}
"""Grounds by name, with the sources of their friction along the track:

R. K. Noon, Engineering Analysis of Vehicular Accidents (1994), of tyres; J. Y. Wong, Theory of Ground Vehicles (2008),
angles of friction, read second-hand.
"""


def load_ground(source: str) -> Ground:
    """Load a named ground, or a TOML file with fields of `Ground` and, as `base`, the named ground that they change.

    Raises InvalidValueError for any other source, SettingsFileError for an unreadable file and invalid fields.
    """
    if source in NAMED_GROUNDS:
        return NAMED_GROUNDS[source]
    table = read_named("ground", source, NAMED_GROUNDS)
    base = table.pop("base", "stone")
    if not isinstance(base, str) or base not in NAMED_GROUNDS:
        raise SettingsFileError(f"{source}: base = {base!r}: must be one of {', '.join(NAMED_GROUNDS)}")
    return build(Ground, table, source, NAMED_GROUNDS[base])
