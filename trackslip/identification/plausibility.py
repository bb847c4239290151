"""Implausible samples: wrong units, signs and gears, with a guess at the cause."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from trackslip.errors import LogError
from trackslip.kinematics import Array, RobotGeometry, body_twist, track_speeds

NEARLY_STANDING = 0.02
"""Ratio of the slower to the faster sprocket speed below which the slower track's slip is meaningless [-]."""
_WILD = 0.8  # slip of the faster track that no robot reaches in steady motion
_SWIFT = 0.4  # ratio of track speeds above which a track cannot move against its sprocket
_TWICE = 3.0  # slip of a track that moves in the opposite direction, twice as fast as its sprocket
_KEPT_SPEED = (0.5, 1.3)  # share of the commanded speed that friction leaves
_KEPT_YAW_RATE = (0.1, 1.5)  # share of the commanded yaw rate that friction leaves
_ASIDE = 0.1  # error of the same, relative to the faster track: radii differ, the sensor sits off the centre
_SIGNIFICANT = 4.0  # yaw rate that is certainly not zero [standard errors]
_NEAR = 1.4  # factor within which a ratio indicates a unit
_SLIPPING = 0.75  # typical ratio of real to commanded speed, to guess a gear
_KEPT_WAY = 0.2  # ratio of measured to commanded ways below which a gear is likely
_FACTORS = (
    ("omega", np.degrees(1), "sprocket speeds in deg/s"),
    ("omega", 60 / (2 * np.pi), "sprocket speeds in rpm"),
    ("v", 1000.0, "millimetres"),
    ("v", 100.0, "centimetres"),
    ("w", np.degrees(1), "headings in degrees"),
    ("t", 1e3, "times in ms"),
    ("t", 1e6, "times in µs"),
    ("t", 1e9, "times in ns"),
)


def require_plausible(
    omega: Array,
    twist: Array,
    slip: Array,
    geometry: RobotGeometry,
    run: Sequence[str],
    yaw_stderr: Array,
) -> None:
    """Raise LogError for samples (n, 2) with implausible slip, or that turn in the wrong direction.

    A robot may lose much of its yaw rate, and its inner track may even be dragged forwards: what moves as commanded to
    within what friction can do is plausible. `yaw_stderr` (n,) is the standard error of the yaw rate [rad/s].
    """
    size = np.abs(omega)
    if (k := _first(size.max(axis=1) == 0)) is not None:
        raise LogError(f"run {run[k]!r}: the sprockets stand still")
    ideal = body_twist(omega, 0.0, geometry)
    fastest = geometry.sprocket_radius * size.max(axis=1)  # (n,) [m/s]
    suspicious = ~_as_commanded(ideal, twist, geometry.half_gauge, fastest)
    speed = track_speeds(twist, geometry.half_gauge)  # (n, 2)
    swift = np.abs(speed) > _SWIFT * np.abs(speed).max(axis=1, keepdims=True)
    against = (slip > 1) & (slip < _TWICE) & swift & suspicious[:, None]
    if (k := _first(against.sum(axis=1) == 1)) is not None:
        track = int(np.argmax(against[k]))
        says, side = geometry.sprocket_radius * omega[k, track], ("left", "right")[track]
        raise LogError(
            f"run {run[k]!r}: its {side} track moves at {speed[k, track]:+.3g} m/s where its sprocket says {says:+.3g} "
            "m/s: does its encoder count backwards?"
        )
    of_faster = slip[np.arange(len(slip)), size.argmax(axis=1)]
    wild = (np.abs(of_faster) > _WILD) & suspicious
    opposite = (ideal[:, 1] * twist[:, 1] < 0) & (np.abs(twist[:, 1]) > 0.2 * np.abs(ideal[:, 1]))
    reversed_turn = opposite & wild & (np.abs(twist[:, 1]) < 2 * np.abs(ideal[:, 1]))
    if (k := _first(wild & ~reversed_turn.any())) is not None:
        radius, guess = geometry.sprocket_radius, unit_guess(ideal[k], twist[k])
        raise LogError(
            f"run {run[k]!r}: slip {of_faster[k]:.3g} of the faster track is implausible (over {_WILD}): check the "
            f"units (rad/s, m, rad, s), the gear and sprocket_radius = {radius:g} m{guess}"
        )
    relevant = geometry.half_gauge * np.abs(twist[:, 1] - ideal[:, 1]) > _ASIDE * fastest
    backwards = opposite & relevant & (np.abs(twist[:, 1]) > _SIGNIFICANT * yaw_stderr)
    if (k := _first(backwards)) is not None:
        raise LogError(
            f"run {run[k]!r}: it turns at {twist[k, 1]:+.3g} rad/s where its sprockets say {ideal[k, 1]:+.3g} rad/s: "
            "are the tracks swapped, does phi run clockwise, or do the encoders count backwards?"
        )


def _as_commanded(ideal: Array, twist: Array, half_gauge: float, fastest: Array) -> np.ndarray:
    """(n,) bool: speed and yaw rate keep their direction and a plausible share of what is commanded, `ideal` (n, 2)."""
    plausible = np.ones(len(twist), bool)
    for column, length, (low, high) in ((0, 1.0, _KEPT_SPEED), (1, half_gauge, _KEPT_YAW_RATE)):
        along = np.sign(ideal[:, column]) * twist[:, column] * length
        commanded = np.abs(ideal[:, column]) * length
        error = np.where(commanded > _ASIDE * fastest, 0.0, _ASIDE * fastest)
        plausible &= (along >= low * commanded - error) & (along <= high * commanded + error)
    return plausible


def _first(bad: np.ndarray | np.bool) -> int | None:
    """Index of the first bad run of (n,)."""
    return int(np.argmax(bad)) if bad.any() else None


def unit_guess(ideal: Array, twist: Array) -> str:
    """A guess at the cause from the ratios of measured to commanded v and w (2,), or an empty text."""
    with np.errstate(divide="ignore", invalid="ignore"):
        v, w = np.abs(twist / ideal)
        slowed = 1 / v

    def near(value: float, factor: float) -> bool:
        return bool(factor / _NEAR < value < factor * _NEAR)

    for what, factor, name in _FACTORS:
        if (
            (what in ("omega", "t") and near(slowed, factor / _SLIPPING**0.5))
            or (what == "v" and near(v, factor))
            or (what == "w" and near(v, 1.0) and near(w, factor * _SLIPPING))
        ):
            return f"; it looks like {name}"
    gear = f"; it looks like a gear of about {slowed:.2g} between encoder and sprocket"
    return gear if 0 < v < _KEPT_WAY else ""  # beyond, wheels may spin on ice
