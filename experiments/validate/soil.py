"""Checks of a robot on soft soil: sinking straight ahead, under a pull and uphill, turning, and
parking on a slope.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from experiments.common.soil import STEEP_TRIM, OnSoil
from experiments.validate.checks import Checks, check_creep
from experiments.validate.measurements import GRAVITY, speed_scale
from sim.fleet.fleet import Fleet
from sim.ground.ground import Ground
from sim.ground.pull import Pull
from sim.robot.parameters import SINK
from trackslip.errors import require
from trackslip.kinematics import Array
from trackslip.skid_theory import Load, Soil, Tracks, Wheels, drawbar_curve, steady_twist

DEEP: Final = 0.1
"""Sinkage over the length of the tracks from which turns and trim are a rough model: so deep, the
soil is so soft that the roundness of the engine's pads stiffens the trim by some per cent [-].
"""
_ROUGH: Final = 0.1  # bound where theory is a rough model [-]
DEEP_WHEEL: Final = 0.2
"""Sinkage over the radius of the wheels from which turns are a rough model: a Husky misses theory
by 0.1 to 0.6 % at 0.16 and less, but by 0.7 and 3.5 % at 0.27 and 0.25 [-].
"""
_SPEED: Final = 0.24  # of the belts of the shipped robot straight ahead [m/s]
_TURNS: Final = ((0.12, 0.20), (0.08, 0.16), (0.20, 0.26), (-0.12, 0.12))  # its belts [m/s]
_PASSES: Final = 6.0  # lengths of the gear until a straight motion is steady
_TURN_PASSES: Final = 3.0  # of the slowest belt, until a turn is steady
_FIRM_SHEAR: Final = 2e-4  # with which wheels under different loads slide alike [m]
_SHARES: Final = (0.3, 0.6)  # pulls over the largest [-]
_SLIPS: Final = np.linspace(0.05, 1.0, 20)  # at which the largest pull is sought
_STEP: Final = 1e-4  # of slips, for the slope of the pull over the slip [-]
_ELSEWHERE: Final = (
    "loads, sliding and work: on soft soil, tests/validation/test_soil.py checks what applies"
)
# sources of what is expected
_BEKKER: Final = "Bekker (trackslip.skid_theory.soil)"
_TRIM: Final = "Bekker, Janosi and Hanamoto, trim (trackslip.skid_theory.soil)"
_BALANCE: Final = "quasi-static balance (trackslip.skid_theory), without slip-sinkage"
_OF_WHEELS: Final = f"{_BALANCE}, cohesion and weight of the soil"
_NO_SPIN: Final = "turns on the spot: wheels deepen their ring with every turn"


@dataclass(frozen=True)
class Straight:
    """Steady motions of N robots straight ahead."""

    slip: Array  # (N,) [-]
    rut: Array  # (N,) depth [m]
    resistance: Array  # (N,) force of compaction [N]
    pitch: Array  # (N,) angle by which the robots point upwards from the ground [rad]


def check_soil(checks: Checks) -> None:
    """Check a robot on the soft soil of `checks`."""
    ground = checks.setup.ground
    assert ground.soil is not None
    soil = ground.soil
    on_soil = OnSoil(checks.setup.parameters, soil, Load())
    # how large pulls may be, for which theory without the contacts' springs is enough
    curve = drawbar_curve(soil, on_soil.gear, _SLIPS, hitch_height=Pull().height)
    largest = float(np.nan_to_num(curve.pull).max())
    allowed = "firm enough to drive on the level"
    require(largest > 0, "ground.soil", soil.source or "this soil", allowed)

    gear = replace(on_soil.gear, settlement=SINK)
    slope = min(checks.gentle_slope, math.asin(_SHARES[-1] * largest / gear.weight))
    check_straight(checks, soil, gear, slope)
    for share in _SHARES:
        _check_pull(checks, soil, gear, share * largest)
    if isinstance(gear, Wheels):
        _check_turns_on_wheels(checks, on_soil)
    else:
        _check_turns_on_tracks(checks, on_soil)
    check_creep(checks)
    checks.not_applicable.append(_ELSEWHERE)


def _drive(
    checks: Checks, gear: Tracks | Wheels, slopes: Array, pull: Pull | None = None
) -> Straight:
    """Drive straight up slopes (N,) [rad] with a pull until the motion is steady."""
    setup = checks.setup
    grounds = [replace(setup.ground, slope=float(slope)) for slope in slopes]
    fleet = setup.fleet(np.zeros((len(slopes), 3)), grounds, pull=pull)
    speed = _SPEED * speed_scale(setup.parameters)
    fleet.command(speed / setup.sprocket_radius)
    _advance(fleet, 1.0 + _PASSES * gear.length / speed)

    before = fleet.pose()
    _advance(fleet, 0.5)
    moved = (fleet.pose() - before)[:, :2]
    distance = np.hypot(moved[:, 0], moved[:, 1])
    assert fleet.ruts is not None
    return Straight(
        slip=1 - distance / (speed * round(0.5 / fleet.period) * fleet.period),
        rut=fleet.ruts.deepest.mean(axis=1),
        resistance=-fleet.ruts.resistance.sum(axis=1),
        pitch=-fleet.attitude()[:, 2],
    )


def _advance(fleet: Fleet, duration: float) -> None:
    """Simulate about a `duration` [s], in whole servo periods."""
    fleet.advance(round(duration / fleet.period) * fleet.period)


def check_straight(checks: Checks, soil: Soil, gear: Tracks | Wheels, slope: float) -> None:
    """Check sinkage and resistance on the level, and the slip up a slope [rad]."""
    driven = _drive(checks, gear, np.array([0.0, slope]))
    level = drawbar_curve(soil, gear, driven.slip[:1])
    depth = level.sinkage[0]
    checks.add("sinkage on the level", [depth, driven.rut[0]], 0.01 * depth, "m", _BEKKER)
    force = level.resistance[0]
    resistance = driven.resistance[0]
    checks.add("resistance on the level", [force, resistance], 0.015 * force, "N", _BEKKER)

    what = f"slip uphill on {math.degrees(slope):.2g}°"
    uphill = drawbar_curve(soil, gear, driven.slip[1:], slope)
    if not _is_too_steep(checks, what, uphill.pitch[0]):
        measured = float(driven.slip[1])
        expected = slip_uphill(soil, gear, slope, measured)
        allowed = 0.002 if isinstance(gear, Wheels) else 0.001
        checks.add(what, [expected, measured], allowed, "1", _TRIM)


def slip_uphill(soil: Soil, gear: Tracks | Wheels, slope: float, near: float) -> float:
    """Slip on a slope [rad] at which nothing is left to pull, by a step of Newton's method from a
    slip `near` it.
    """
    around = drawbar_curve(soil, gear, near + _STEP * np.array([-1.0, 0.0, 1.0]), slope)
    gain = (around.pull[2] - around.pull[0]) / (2 * _STEP)
    return float(near - around.pull[1] / gain)


def _check_pull(checks: Checks, soil: Soil, gear: Tracks | Wheels, force: float) -> None:
    """Check the pull at the slip that one of this force takes on the level [N], and the pitch."""
    pull = Pull(force, since=1.0)
    driven = _drive(checks, gear, np.zeros(1), pull)
    theory = drawbar_curve(soil, gear, driven.slip, hitch_height=pull.height)
    what = f"pull of {force / gear.weight:.2g} of the weight"
    if _is_too_steep(checks, what, theory.pitch[0]):
        return
    allowed = 0.002 * gear.weight
    checks.add(f"{what}, at its slip", [theory.pull[0], force], allowed, "N", _TRIM)
    pitch = theory.pitch[0]
    is_deep = isinstance(gear, Tracks) and theory.sinkage[0] > DEEP * gear.length
    allowed = _ROUGH * abs(pitch) if is_deep else math.radians(0.05)
    checks.add(f"{what}: pitch", [pitch, driven.pitch[0]], allowed, "rad", _TRIM)


def _is_too_steep(checks: Checks, what: str, pitch: float) -> bool:
    """True, with a note on `what`, if the robot tilts by more than STEEP_TRIM, or tips over in
    theory, whose `pitch` is then NaN [rad].
    """
    if pitch <= STEEP_TRIM:
        return False
    limit = math.degrees(STEEP_TRIM)
    reason = f"the robot tilts by more than {limit:.0f}°, where theory of the trim is rough"
    checks.not_applicable.append(f"{what}: {reason}")
    return True


def _check_turns_on_tracks(checks: Checks, on_soil: OnSoil) -> None:
    """Check turns, and turns on the spot, on this soil without slip-sinkage."""
    even = replace(on_soil, soil=replace(on_soil.soil, n1=0.0))
    belts = speed_scale(on_soil.robot) * np.array(_TURNS)
    contact, shear, load = even.turning()
    measured = _half_widths(checks, even, belts)
    is_spin = belts.sum(axis=1) == 0
    is_deep = even.sinkage > DEEP * even.tracks.length
    for what, rows, own_load, bound in (
        ("b + D in turns", ~is_spin, load, 0.01),
        ("b + D on the spot", is_spin, Load(), 0.013),  # in a rut, nothing resists
    ):
        twist = steady_twist(belts[rows], contact, GRAVITY, shear, own_load)
        theory = _half_width(belts[rows], twist[:, 2])
        allowed = (_ROUGH if is_deep else bound) * theory
        checks.add(what, [theory, measured[rows]], allowed, "m", _BALANCE)


def _check_turns_on_wheels(checks: Checks, on_soil: OnSoil) -> None:
    """Check turns on this soil without slip-sinkage, cohesion and weight, so that the friction of
    all wheels is the same.
    """
    frictional = replace(on_soil.soil, n1=0.0, cohesion=0.0, unit_weight=0.0, shear=_FIRM_SHEAR)
    even = replace(on_soil, soil=frictional)
    turns = [belts for belts in _TURNS if sum(belts) != 0]
    belts = speed_scale(on_soil.robot) * np.array(turns)
    contact, shear, load = even.turning()
    measured = _half_widths(checks, even, belts)
    twist = steady_twist(belts, contact, GRAVITY, shear, load)
    theory = _half_width(belts, twist[:, 2])
    is_deep = even.sinkage > DEEP_WHEEL * even.wheels.radius
    allowed = (_ROUGH if is_deep else 0.01) * theory
    checks.add("b + D in turns", [theory, measured], allowed, "m", _OF_WHEELS)
    checks.not_applicable.append(_NO_SPIN)


def _half_widths(checks: Checks, on_soil: OnSoil, belts: Array) -> Array:
    """Measured b + D (N,) of steady turns with belts (N, 2) [m/s] on a soil [m]."""
    setup = checks.setup
    fleet = setup.fleet(np.zeros((len(belts), 3)), Ground(soil=on_soil.soil))
    fleet.command(belts / setup.sprocket_radius)
    slowest = float(np.abs(belts).min())
    _advance(fleet, _TURN_PASSES * on_soil.gear.length / slowest)
    before = fleet.pose()[:, 2]
    _advance(fleet, 1.0)
    rate = (fleet.pose()[:, 2] - before) / (round(1.0 / fleet.period) * fleet.period)
    return _half_width(belts, rate)


def _half_width(belts: Array, rate: Array) -> Array:
    """b + D (N,) of turns with belts (N, 2) [m/s] at rates (N,) [rad/s], in m."""
    return np.asarray((belts[:, 1] - belts[:, 0]) / (2 * rate))
