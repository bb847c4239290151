"""Angles of a joint over time, from positions that may be wrapped, or else from velocities."""

from __future__ import annotations

import numpy as np

from trackslip.kinematics import Array

LIKE = (0.8, 1.25)
"""Ratios of changes of position to velocities that are alike."""
_TURN = 2 * np.pi
_TOLERANCE = 0.01  # by which wrapped positions may leave their range [rad]
_MOVES = 1e-3  # speed above which a joint that reports it should move [rad/s]
_FAR = 0.8 * np.pi  # turn between readings above which wrapped positions may be ambiguous [rad]
_LEAP = 5.0  # speed of a leap by the usual largest speed
_MIN_LEAP = 2 * np.pi  # [rad]


def has_positions(position: Array, velocity: Array) -> bool:
    """Whether positions (T,) are measured: finite, and not at rest while velocities (T,) aren't."""
    if not np.isfinite(position).mean() > 0.5:
        return False
    still = bool(np.ptp(position[np.isfinite(position)]) == 0.0)
    return not (still and np.isfinite(velocity).any() and np.nanmax(np.abs(velocity)) > _MOVES)


def has_velocities(velocity: Array) -> bool:
    """Whether velocities (T,) are measured."""
    return bool(np.isfinite(velocity).mean() > 0.5)


def from_velocities(time: Array, velocity: Array) -> Array:
    """Angles (T,) [rad], 0 at first, from velocities (T,) [rad/s] at times (T,) [s], linear in between."""
    turned = (velocity[1:] + velocity[:-1]) / 2 * np.diff(time)
    return np.concatenate([[0.0], np.cumsum(turned)])


def from_positions(time: Array, position: Array, velocity: Array) -> tuple[Array, int]:
    """Continuous angles (T,) [rad], 0 at first, and the number of leaps bridged.

    Positions (T,) [rad] that stay within -π and π or 0 and 2π are unwrapped, by velocities (T,) [rad/s] where a joint
    turns too far between readings. A leap, as when an encoder is reset, is bridged by the velocity or the steps around.
    """
    step, interval = np.diff(position), np.diff(time)
    velocity = (
        velocity if np.any(velocity) else np.full_like(velocity, np.nan)
    )  # zeros fill a field that isn't measured
    low, high = position.min() + _TOLERANCE, position.max() - _TOLERANCE
    leaps = 0
    if any(start <= low and high <= start + _TURN for start in (-np.pi, 0.0)):
        step = _unwrapped(step, interval, velocity)
    else:
        step, leaps = _bridged(step, interval, velocity)
    return np.concatenate([[0.0], np.cumsum(step)]), leaps


def speed_ratio(time: Array, angle: Array, velocity: Array) -> float:
    """How many times as fast angles (T,) at times (T,) turn as velocities (T,) say; NaN where these say nothing."""
    told = (velocity[1:] + velocity[:-1]) / 2
    known = np.isfinite(told)
    square = float((told[known] ** 2).sum())
    return float((np.diff(angle) / np.diff(time))[known] @ told[known]) / square if square else np.nan


def _unwrapped(step: Array, interval: Array, velocity: Array) -> Array:
    """Steps (T - 1,) without the turns that wrapping has hidden."""
    near = step - _TURN * np.round(step / _TURN)
    expected = (velocity[1:] + velocity[:-1]) / 2 * interval
    known = np.isfinite(expected)
    clear = known & (np.abs(expected) < 1.0)
    if not known.any() or np.abs(expected[known]).max() < _FAR or not clear.any():
        return near
    square = (expected[clear] ** 2).sum()
    if not square or not LIKE[0] < (near[clear] * expected[clear]).sum() / square < LIKE[1]:
        return near
    turns = np.round(np.where(known, expected - near, 0.0) / _TURN)
    return np.asarray(near + _TURN * turns)


def _bridged(step: Array, interval: Array, velocity: Array) -> tuple[Array, int]:
    """Steps (T - 1,) without leaps, and the number of these."""
    speed = step / interval
    usual = np.sort(np.abs(speed))[-max(4, len(speed) // 200) :][0]
    leap = (np.abs(speed) > _LEAP * usual) & (np.abs(step) > _MIN_LEAP)
    if not leap.any() or leap.all():
        return step, 0
    told = (velocity[1:] + velocity[:-1]) / 2
    around = np.interp(np.flatnonzero(leap), np.flatnonzero(~leap), speed[~leap])
    bridge = np.where(np.isfinite(told[leap]), told[leap], around)
    step = step.copy()
    step[leap] = bridge * interval[leap]
    return step, int(leap.sum())
