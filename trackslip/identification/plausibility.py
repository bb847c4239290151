"""Detection of implausible samples, with a guess at the cause."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from trackslip.errors import LogError
from trackslip.kinematics import Array, RobotGeometry, body_twist

_NEARLY_STANDING = 0.02  # ratio of the slower to the faster sprocket speed below which its slip is meaningless
_WILD = 0.8  # slip of the faster track that no robot reaches in steady motion
_SWIFT = 0.4  # ratio of track speeds above which a track cannot move against its sprocket
_TWICE = 3.0  # slip of a track that moves in the opposite direction, twice as fast as its sprocket
_NEAR = 1.4  # factor within which a ratio indicates a unit
_SLIPPING = 0.75  # typical ratio of real to commanded speed, to guess a gear
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


def require_plausible(omega: Array, twist: Array, slip: Array, geometry: RobotGeometry, run: Sequence[str]) -> None:
    """Raise LogError for samples (n, 2) with undefined or implausible slip, or that turn in the wrong direction."""
    if (k := _first(~np.isfinite(slip).all(axis=1))) is not None:
        raise LogError(f"run {run[k]!r}: a sprocket stands still, its slip is undefined")
    size = np.abs(omega)
    if (k := _first(size.min(axis=1) < _NEARLY_STANDING * size.max(axis=1))) is not None:
        raise LogError(
            f"run {run[k]!r}: one sprocket nearly stands ({omega[k].min():.3g} and {omega[k].max():.3g} rad/s): "
            "its slip is meaningless, leave the run out"
        )
    speed = geometry.sprocket_radius * omega * (1 - slip)  # (n, 2) of the tracks over the ground
    swift = np.abs(speed) > _SWIFT * np.abs(speed).max(axis=1, keepdims=True)
    against = (slip > 1) & (slip < _TWICE) & swift
    if (k := _first(against.sum(axis=1) == 1)) is not None:
        track = int(np.argmax(against[k]))
        says = geometry.sprocket_radius * omega[k, track]
        raise LogError(
            f"run {run[k]!r}: its {('left', 'right')[track]} track moves at {speed[k, track]:+.3g} m/s where its "
            f"sprocket says {says:+.3g} m/s: does its encoder count backwards?"
        )
    of_faster = np.take_along_axis(slip, size.argmax(axis=1)[:, None], axis=1)[:, 0]
    wild = np.abs(of_faster) > _WILD
    ideal = body_twist(omega, 0.0, geometry)
    backwards = (ideal[:, 1] * twist[:, 1] < 0) & (np.abs(twist[:, 1]) > 0.2 * np.abs(ideal[:, 1]))
    reversed_turn = backwards & wild & (np.abs(twist[:, 1]) < 2 * np.abs(ideal[:, 1]))
    if (k := _first(wild & ~reversed_turn.any())) is not None:
        raise LogError(
            f"run {run[k]!r}: slip {of_faster[k]:.3g} of the faster track is implausible (over {_WILD}): "
            f"check the units (rad/s, m, rad, s), the gear and sprocket_radius = {geometry.sprocket_radius:g} m"
            f"{_guess(ideal[k], twist[k])}"
        )
    if (k := _first(backwards)) is not None:
        raise LogError(
            f"run {run[k]!r}: it turns at {twist[k, 1]:+.3g} rad/s where its sprockets say {ideal[k, 1]:+.3g} rad/s: "
            "are the tracks swapped, or phi not counter-clockwise?"
        )


def _first(bad: np.ndarray | np.bool) -> int | None:
    """Index of the first bad run of (n,)."""
    return int(np.argmax(bad)) if bad.any() else None


def _guess(ideal: Array, twist: Array) -> str:
    """A guess at the cause from the ratios of measured to commanded v and w (2,), or an empty text."""
    with np.errstate(divide="ignore", invalid="ignore"):
        v, w = np.abs(twist / ideal)

    def near(value: float, factor: float) -> bool:
        return bool(factor / _NEAR < value < factor * _NEAR)

    for what, factor, name in _FACTORS:
        if (
            (what in ("omega", "t") and near(1 / v, factor / _SLIPPING**0.5))
            or (what == "v" and near(v, factor))
            or (what == "w" and near(v, 1.0) and near(w, factor * _SLIPPING))
        ):
            return f"; it looks like {name}"
    return f"; it looks like a gear of about {1 / v:.3g} between encoder and sprocket" if 0 < v < 1 / 2 else ""
