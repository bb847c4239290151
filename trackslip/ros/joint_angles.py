"""Angles of joints over time, from positions that may be wrapped or velocities, and mean turns of a side's joints."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from scipy.integrate import cumulative_trapezoid

from trackslip.errors import LogError, counted
from trackslip.kinematics import Array

_ALIKE = (0.8, 1.25)  # ratios of turns that are alike [-]
_TURN = 2 * np.pi
_TOLERANCE = 0.01  # by which wrapped positions may leave their range [rad]
_MOVES = 1e-3  # speed above which a joint that reports it should move [rad/s]
_FAR = 0.8 * np.pi  # turn between readings above which wrapped positions may be ambiguous [rad]
_LEAP = 5.0  # speed of a leap by the usual largest speed
_MIN_LEAP = 2 * np.pi  # [rad]
_STILL = 0.01  # way over that of the wheel that turns most, below which a wheel's encoder is dead [-]
_MIN_WAY = 1.0  # of the wheel that turns most, for a judgement [rad]
_AGAINST = -0.5  # correlation below which wheels turn against each other [-]


def has_positions(position: Array, velocity: Array) -> bool:
    """True if positions (T,) are measured: mostly finite, and not at rest while velocities (T,) aren't."""
    known = np.isfinite(position)
    if known.mean() <= 0.5:
        return False
    at_rest = bool(np.ptp(position[known]) == 0.0)
    return not (at_rest and np.abs(velocity[np.isfinite(velocity)]).max(initial=0.0) > _MOVES)


def from_velocities(time: Array, velocity: Array) -> Array:
    """Angles (T,) [rad], 0 at first, from velocities (T,) [rad/s] at times (T,) [s], linear in between."""
    return np.asarray(cumulative_trapezoid(velocity, time, initial=0.0))


def from_positions(joint: str, time: Array, position: Array, velocity: Array, notes: list[str]) -> Array:
    """Continuous angles (T,) [rad], 0 at first.

    Positions (T,) [rad] that stay within -π and π or 0 and 2π are unwrapped, by velocities (T,) [rad/s] where a joint
    turns too far between readings. A leap, as when an encoder is reset, is bridged by the velocity or the steps around.
    `notes` gets a line, with the name of the joint, for leaps and for velocities that contradict the positions.
    """
    step, interval = np.diff(position), np.diff(time)
    stated = (velocity[1:] + velocity[:-1]) / 2 * interval
    if not np.any(velocity):  # zeros fill a field that isn't measured
        stated = np.full_like(step, np.nan)
    if any(low - _TOLERANCE <= position.min() and position.max() <= low + _TURN + _TOLERANCE for low in (-np.pi, 0.0)):
        step = _unwrapped(step, stated)
    else:
        step, leaps = _bridged(step, interval, stated)
        if leaps:
            notes.append(f"{joint}: its position leaps {counted(leaps, 'time')}: bridged")
    ratio = _ratio(step / interval, stated / interval)
    if np.isfinite(ratio) and not _ALIKE[0] < ratio < _ALIKE[1]:
        notes.append(
            f"{joint}: its positions turn {ratio:.3g} times as fast as its velocities say: positions are taken"
        )
    return np.append(0.0, np.cumsum(step))


def _ratio(turns: Array, of: Array) -> float:
    """The multiple of the turns `of` (n,) that turns (n,) are, by least squares; NaN where these aren't known."""
    known = np.isfinite(of)
    square = float(of[known] @ of[known])
    return float(turns[known] @ of[known]) / square if square else np.nan


def _unwrapped(step: Array, stated: Array) -> Array:
    """Steps (n,) without the turns that wrapping has hidden, by those that velocities state where they must."""
    near = step - _TURN * np.round(step / _TURN)
    clear = np.abs(stated) < 1.0
    if np.nanmax(np.abs(stated), initial=0.0) < _FAR or not _ALIKE[0] < _ratio(near[clear], stated[clear]) < _ALIKE[1]:
        return near
    return np.asarray(near + _TURN * np.round(np.where(np.isfinite(stated), stated - near, 0.0) / _TURN))


def _bridged(step: Array, interval: Array, stated: Array) -> tuple[Array, int]:
    """Steps (n,) without leaps, and the number of these."""
    speed = step / interval
    usual = np.sort(np.abs(speed))[-max(4, len(speed) // 200) :][0]
    leap = (np.abs(speed) > _LEAP * usual) & (np.abs(step) > _MIN_LEAP)
    if not leap.any() or leap.all():
        return step, 0
    around = np.interp(np.arange(len(step)), np.flatnonzero(~leap), speed[~leap]) * interval
    return np.where(leap, np.where(np.isfinite(stated), stated, around), step), int(leap.sum())


def side_turns(topic: str, side: Sequence[str], turns: Mapping[str, Array], notes: list[str]) -> Array:
    """Mean turns (n,) [rad] in each interval of the wheels of a side, of those `turns` that are measured.

    An encoder that stands still while others turn is left out, with a note. Raises LogError, with the topic and the
    names, if wheels turn against each other.
    """
    ways = {name: float(np.abs(turns[name]).sum()) for name in side}
    most = max(ways, key=lambda name: ways[name])
    if ways[most] <= _MIN_WAY:
        return np.asarray(np.mean([turns[name] for name in side], axis=0))
    kept = []
    for name in side:
        if ways[name] < _STILL * ways[most]:
            notes.append(f"topic {topic}: joint {name} left out: it stands still while {most} turns")
            continue
        kept.append(name)
        ratio = _ratio(turns[name], turns[most])
        if ratio * np.linalg.norm(turns[most]) < _AGAINST * np.linalg.norm(turns[name]):
            raise LogError(
                f"topic {topic}: joints {most} and {name} of one side turn against each other: "
                "choose with --left NAMES --right NAMES"
            )
        if not _ALIKE[0] < ratio < _ALIKE[1]:
            notes.append(f"topic {topic}: joint {name} turns {ratio:.2g} times as fast as {most}: their mean is taken")
    return np.asarray(np.mean([turns[name] for name in kept], axis=0))
