"""What columns hold instead of what they should: zeros, angles, other units, swapped sides; each refused in a line."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import product

import numpy as np

from trackslip.errors import LogError, counted
from trackslip.identification.gains import Gains, Steps, Window, windows_of
from trackslip.identification.preparation import PreparedDrive
from trackslip.kinematics import Array, RobotGeometry, wrap_angle

EXACTLY = 0.05
"""Relative error of a gain within which it is that of a unit: tracks that are not on ice lose no more of a distance."""
CLEARLY = 0.8
"""Correlation that leaves no doubt; wrong sides reach 0.6 on random drives of two minutes (test_first_look)."""
_FEWEST = 5  # windows that are compared, rows that are a habit
_LEAST = 0.05  # motion in windows that is some [m or rad]
_MANY = 0.1  # share of rows between others that are no readings
_WRAPPED, _FASTEST = 20.0, 100.0  # times the usual speed, and speed [rad/s], that no wheel reaches for a reading
_SPEED_UNITS = {
    np.radians(1): "omega_l and omega_r look like deg/s: multiply them by pi/180",
    2 * np.pi / 60: "omega_l and omega_r look like rpm: multiply them by 2 pi/60",
    2 * np.pi: "omega_l and omega_r look like turns per second: multiply them by 2 pi",
    1000.0: "x and y look like mm: divide them by 1000",
    100.0: "x and y look like cm: divide them by 100",
    1e-3: "t looks like ms: divide it by 1000",
    1e-6: "t looks like µs: divide it by 1e6",
    1e-9: "t looks like ns: divide it by 1e9",
}
_DEGREE = 111_320.0  # of latitude, mean [m]


def refuse_zeros(drive: PreparedDrive) -> None:
    """Zeros in cells that should be empty."""
    zero = (drive.pose == 0).all(axis=1) if drive.has_heading else (drive.pose[:, :2] == 0).all(axis=1)
    if _in_between(zero):
        names = "x, y and phi" if drive.has_heading else "x and y"
        raise LogError(
            f"run {drive.name!r}: columns {names} go to 0 and back {_in_between(zero):,} times: leave cells empty "
            "where no pose was measured"
        )
    still = (drive.omega == 0).all(axis=1)
    if _in_between(still) and not drive.coarse:
        raise LogError(
            f"run {drive.name!r}: columns omega_l and omega_r go to 0 and back {_in_between(still):,} times: leave "
            "cells empty where no encoder was read"
        )


def _in_between(zero: np.ndarray) -> int:
    """Number of rows (n,) that are zero between others, or others between zeros, if that is a habit."""
    alone = (zero[1:-1] != zero[:-2]) & (zero[1:-1] != zero[2:])
    count = int(alone.sum())
    return count if count > max(_FEWEST, _MANY * len(zero)) else 0


def refuse_wrapped(drive: PreparedDrive) -> None:
    """Single readings that no wheel reaches: a counter began anew."""
    for name, omega in zip(("omega_l", "omega_r"), drive.omega.T, strict=True):
        speed = np.abs(omega)
        around = np.maximum(np.append(0.0, speed[:-1]), np.append(speed[1:], 0.0))
        usual = np.maximum(np.quantile(speed, 0.99), around)
        wild = np.flatnonzero((speed > _WRAPPED * usual) & (speed > _FASTEST))
        if len(wild):
            k = int(wild[0])
            raise LogError(
                f"run {drive.name!r}: column {name} is {omega[k]:.3g} rad/s at t = {drive.edges[k + 1]:.12g} s, "
                f"{speed[k] / usual[k]:.0f} times its usual speed ({counted(len(wild), 'row')}): if its counter began "
                "anew there, unwrap the ticks; else leave the cell empty"
            )


def refuse_angles(drives: Sequence[PreparedDrive], geometry: RobotGeometry) -> None:
    """Angles of wheels where speeds belong: the motion follows their differences."""
    measured, speeds, angles = [], [], []
    for drive in drives:
        steps = Steps.of(drive, geometry, 0.0)
        ends = steps.ends(max(2.0, 2 * drive.interval))
        if len(ends) < 3:
            continue
        change = np.diff(drive.omega, axis=0, prepend=drive.omega[:1])
        if np.ptp(drive.omega) <= 2 * np.pi * (1 + EXACTLY):  # angles that wrap
            change = wrap_angle(change)
        left, right = (np.diff(np.interp(steps.time[ends], drive.edges[1:], a)) for a in np.cumsum(change, axis=0).T)
        if steps.place is not None:
            measured.append(np.abs(np.diff(steps.place[ends])))
            speeds.append(np.abs(np.add.reduceat(steps.distance, ends[:-1])))
            angles.append(np.abs(left + right))
        else:
            assert steps.heading is not None
            measured.append(np.diff(steps.heading[ends]))
            speeds.append(np.add.reduceat(steps.turn, ends[:-1]))
            angles.append(right - left)
    if sum(map(len, measured)) < 2 * _FEWEST:
        return
    by_speeds, by_angles = (_alike(np.concatenate(measured), np.concatenate(by)) for by in (speeds, angles))
    if by_angles > CLEARLY and 1 - by_angles**2 < (1 - by_speeds**2) / 2:
        most = max(float(np.abs(drive.omega).max()) for drive in drives)
        raise LogError(
            f"columns omega_l and omega_r look like angles (up to {most:.3g}), not speeds: the robot moves as they "
            "change: give their changes over time, in rad/s"
        )


def _alike(first: np.ndarray, second: np.ndarray) -> float:
    """Correlation around zero of motions, by the real part if they are complex; NaN is left out."""
    known = np.isfinite(first) & np.isfinite(second)
    first, second = first[known], second[known]
    size = float(np.sqrt(np.sum(np.abs(first) ** 2) * np.sum(np.abs(second) ** 2)))
    return float(np.sum(first * second).real) / size if size > 0 else 0.0


def refuse_headings(drive: PreparedDrive, geometry: RobotGeometry, clock: float) -> None:
    """Headings in degrees, clockwise, or the z of a quaternion, by the course of the path."""
    steps = Steps.of(drive, geometry, clock)
    ends = steps.ends(max(0.5, drive.interval))
    if steps.place is None or steps.heading is None or len(ends) < _FEWEST:
        return
    chord = np.diff(steps.place[ends])
    long = np.abs(chord) > max(0.5 * float(np.sqrt(np.mean(np.abs(chord) ** 2))), 1e-9)
    phi = ((steps.heading[ends[1:]] + steps.heading[ends[:-1]]) / 2)[long]
    direction = np.angle(chord[long])
    if len(phi) < _FEWEST:
        return

    def agreement(values: Array) -> float:
        return float(np.abs(np.mean(np.exp(2j * (direction - values)))))

    right = agreement(phi)
    if right > CLEARLY:
        return
    where = f"run {drive.name!r}: column phi (from {phi.min():.3g} to {phi.max():.3g})"
    if agreement(np.radians(phi)) > max(CLEARLY, right + 0.2):
        raise LogError(f"{where} is in degrees by the course of x and y: multiply it by pi/180")
    if agreement(-phi) > max(CLEARLY, right + 0.2):
        window = windows_of(drive, geometry, clock)
        if _alike(window.turned, window.turn) < 0:
            raise LogError(f"{where} runs clockwise by the course of x and y: change its sign")
        raise LogError(
            f"run {drive.name!r}: the course of x and y runs clockwise by phi and the wheels: exchange x and y, or "
            "mirror one of them"
        )
    if np.abs(phi).max() <= 1.01:
        cosine = 1 - 2 * np.clip(phi, -1, 1) ** 2  # of the heading, whatever the sign of w
        if np.corrcoef(2 * cosine**2 - 1, np.cos(2 * direction))[0, 1] > CLEARLY:
            raise LogError(f"{where} looks like the z of a quaternion: give phi = 2 atan2(z, w)")


def refuse_sides(drives: Sequence[PreparedDrive], geometry: RobotGeometry, clock: float) -> None:
    """Refuse swapped and reversed sides: those with which the wheels would match the poses much better."""
    matches = dict[tuple[bool, int, int], Array]()
    for swapped, left, right in product((False, True), (1, -1), (1, -1)):
        windows = []
        for drive in drives:
            omega = drive.omega * [left, right]  # signs of the columns as they are
            windows.append(windows_of(replace(drive, omega=omega[:, ::-1] if swapped else omega), geometry, clock))
        matches[swapped, left, right] = np.array(matches_of(Window.joined(windows)))
        if matches[False, 1, 1].min(initial=1.0) > CLEARLY:
            return  # as it is, the first one
    best = max(matches, key=lambda side: matches[side].sum())
    match, now = matches[best], matches[False, 1, 1]
    if match.sum() < now.sum() + 0.2 or match.mean() < CLEARLY:
        return
    placed, headed = (any(np.isfinite(drive.pose[:, k]).any() for drive in drives) for k in (0, 2))
    swapped, left, other = best
    if left == other and not (placed and headed):
        what = (
            "the turns are mirrored: exchange omega_l and omega_r, or change the signs of both if they count backwards"
        )
    elif (left, other) == (1, 1):
        what = "the turns are mirrored: are the tracks swapped? Exchange omega_l and omega_r"
    elif (left, other) == (-1, -1) and not swapped:
        what = "both encoders count backwards: change the signs of omega_l and omega_r, for a bag by --reversed both"
    elif (left, other) == (-1, -1):
        what = "the robot moves backwards where its wheels drive forwards: turn phi by pi, or exchange omega_l and "
        what += "omega_r and change their signs"
    elif not swapped:
        name, column = ("left", "omega_l") if left < 0 else ("right", "omega_r")
        what = f"the {name} encoder counts backwards: change the sign of {column}, for a bag by --reversed {name}"
    else:
        column = "omega_l" if left < 0 else "omega_r"
        what = (
            f"the tracks are swapped and one encoder counts backwards: change the sign of {column}, then exchange both"
        )
    raise LogError(f"{what} (correlation with the poses {match.mean():.2f} then, {now.mean():.2f} as it is)")


def matches_of(window: Window) -> list[float]:
    """Correlations of wheels and poses: of sizes of distances, of distances, of turns, as far as wheels have them."""
    found = []
    if np.isfinite(window.moved).sum() >= _FEWEST and _rms(window.distance) > _LEAST:
        found.append(_alike(np.abs(window.moved), np.abs(window.distance)))
        if (window.moved.imag != 0).any():  # with headings
            found.append(_alike(window.moved, window.distance))
    if np.isfinite(window.turned).sum() >= _FEWEST and _rms(window.turn) > _LEAST:
        found.append(_alike(window.turned, window.turn))
    return found


def _rms(values: Array) -> float:
    return float(np.sqrt(np.nanmean(values**2)))


def refuse_units(gains: Gains, geometry: RobotGeometry) -> None:
    """Refuse a gain that is that of a unit."""
    if gains.speed is None:
        return
    value = abs(gains.speed.value)
    units = _SPEED_UNITS | {
        1 / geometry.sprocket_radius: "omega_l and omega_r look like m/s: divide them by sprocket_radius = "
        f"{geometry.sprocket_radius:g} m"
    }
    near = {unit: line for unit, line in units.items() if abs(unit - 1) > 0.2 and abs(value / unit - 1) <= EXACTLY}
    if near:
        times = " or ".join(f"{unit:.4g}" for unit in near)
        raise LogError(
            f"the poses move {value:.4g} times as far as the wheels ({times}): {', or '.join(near.values())}"
        )


def refuse_degrees(drives: Sequence[PreparedDrive], geometry: RobotGeometry, clock: float) -> None:
    """Refuse longitude and latitude, in any order."""
    place = np.concatenate([drive.pose[:, :2] for drive in drives])
    if not np.isfinite(place).any() or (np.nanmax(np.abs(place), axis=0) > 180).any():
        return
    middle, most = np.nanmean(place, axis=0), np.nanmax(np.abs(place), axis=0)

    def moved(scale: Array) -> float:
        """Measured distances over those of the wheels, with x and y in other units."""
        windows = [
            windows_of(
                replace(drive, pose=np.column_stack([(drive.pose[:, :2] - middle) * scale, drive.pose[:, 2]])),
                geometry,
                clock,
            )
            for drive in drives
        ]
        window = Window.joined(windows)
        known = np.isfinite(window.moved)
        return float(np.abs(window.moved[known]).sum() / max(np.abs(window.distance[known]).sum(), 1e-9))

    if moved(np.ones(2)) > 1e-3:
        return
    for lat in (1, 0):
        scale = np.full(2, _DEGREE)
        scale[1 - lat] *= np.cos(np.radians(middle[lat]))
        if most[lat] <= 90 and abs(moved(scale) - 1) <= 4 * EXACTLY:
            names = "longitude and latitude" if lat else "latitude and longitude"
            raise LogError(
                f"x and y (about {middle[0]:.6g}, {middle[1]:.6g}) look like degrees of {names}: give metres in a "
                "plane, x = 111320 cos(lat) (lon - lon0) and y = 111320 (lat - lat0)"
            )
