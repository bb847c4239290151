"""Refuses columns that hold the wrong data (zeros, angles, wrong units, swapped sides), with
one-line messages.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import product
from typing import Final

import numpy as np

from trackslip.drives.conditioning import FEW
from trackslip.drives.drive import Drive, Drives
from trackslip.drives.gains import Gains, Window, rms, windows_of
from trackslip.errors import LogError, counted
from trackslip.kinematics import Array, RobotGeometry

# largest relative deviation of a gain from a wrong unit's factor: tracks slip no more, except on
# ice
_EXACTLY: Final = 0.05
# least correlation that leaves no doubt; swapped sides reach 0.6 in two-minute drives
_CLEARLY: Final = 0.8
# least increase in the sum of the correlations for which another reading counts as better
_BETTER: Final = 0.2
# rms belt speed at which no robot turns by an ambiguous angle between two poses [m/s]
_SLOW: Final = 0.2


def refuse_cells(drive: Drive) -> None:
    """Refuse single speeds that no wheel reaches, such as those from a counter that restarts."""
    for name, speed in zip(("omega_l", "omega_r"), np.abs(drive.omega).T, strict=True):
        around = np.maximum(np.append(0.0, speed[:-1]), np.append(speed[1:], 0.0))
        usual = np.maximum(np.quantile(speed, 0.99), around)
        wild = np.flatnonzero((speed > 20 * usual) & (speed > 100.0))
        if len(wild):
            k = int(wild[0])
            raise LogError(
                f"run {drive.name!r}: column {name} is {speed[k]:.3g} rad/s at t = "
                f"{drive.edges[k + 1]:.12g} s, "
                f"{speed[k] / usual[k]:.0f} times its usual speed ({counted(len(wild), 'row')}): "
                "if its counter began "
                "anew there, unwrap the ticks; else leave the cell empty"
            )


def refuse_readings(
    drives: Sequence[Drive],
    window: Window,
    now: Array,
    geometry: RobotGeometry,
    clock: float,
) -> None:
    """Refuse columns that match far better if reinterpreted, as with swapped sides; `now` has the
    matches as logged.
    """
    if len(now) and now.min() > _CLEARLY:
        return
    readings = [_angles(drives, geometry), *(_other_readings(drives) if len(now) else ())]
    matches = [
        matches_of(windows_of(Drives.of(others), geometry, clock)) for others, *_ in readings
    ]
    best = int(np.argmax([match.sum() for match in matches]))
    match, (_, what, advice) = matches[best], readings[best]
    if match.sum() > now.sum() + _BETTER and match.mean() > _CLEARLY:
        before = now.mean() if len(now) else 0.0
        raise LogError(
            f"{what} (wheels and poses correlate by {before:.2f}, else by {match.mean():.2f}): "
            f"{advice}"
        )
    phi = np.concatenate([drive.pose[:, 2] for drive in drives])
    if len(now) and np.abs(phi).max() <= 1.01 and np.ptp(np.cumsum(window.turn)) > 2 * np.pi:
        raise LogError(
            "column phi, from -1 to 1, looks like the z of a quaternion: give phi = 2 atan2(z, w)"
        )


_Reading = tuple[list[Drive], str, str]
"""Drives with reinterpreted columns, the error message if these match better, and advice to the
user.
"""


def _angles(drives: Sequence[Drive], geometry: RobotGeometry) -> _Reading:
    """Reinterpret the speed columns as angles or counters that may wrap: speeds are their scaled
    changes.
    """
    others = []
    for drive in drives:
        change, span = (
            np.diff(drive.omega, axis=0, prepend=drive.omega[:1]),
            np.ptp(drive.omega, axis=0),
        )
        change -= span * np.round(change / np.maximum(span, 1e-9))
        speeds = change / np.diff(drive.edges)[:, None]
        others.append(
            replace(drive, omega=_SLOW / geometry.sprocket_radius / max(rms(speeds), 1e-9) * speeds)
        )
    most = max(float(np.abs(drive.omega).max()) for drive in drives)
    what = f"columns omega_l and omega_r look like angles or ticks (up to {most:.3g}), not speeds"
    return others, what, "give their changes over time, in rad/s"


def _other_readings(drives: Sequence[Drive]) -> Iterator[_Reading]:
    """Yield reinterpretations of drives: swapped sides, changed signs and other headings."""
    names = {
        (-1, 1): ("omega_l", "left"),
        (1, -1): ("omega_r", "right"),
        (-1, -1): ("omega_l and omega_r", "both"),
    }
    placed, headed = (any(np.isfinite(drive.pose[:, k]).any() for drive in drives) for k in (0, 2))
    for swapped, signs in [*product((False, True), ((1, 1), *names))][1:]:
        steps = (
            ["change the sign of {}, for a bag by --reversed {}".format(*names[signs])]
            if signs in names
            else []
        )
        advice = ", then ".join([*steps, "exchange omega_l and omega_r"] if swapped else steps)
        # positions or headings alone don't tell these apart
        if signs[0] == signs[1] and not (placed and headed):
            advice = (
                "exchange omega_l and omega_r, or change the signs of both if they count backwards"
            )
        elif swapped and signs == (-1, -1):
            advice += ", or turn phi by pi"
        elif swapped and signs == (1, 1):
            advice += ", or change the signs of y and phi if phi runs clockwise"
        others = [
            replace(drive, omega=(drive.omega * signs)[:, :: -1 if swapped else 1])
            for drive in drives
        ]
        yield others, "tracks are swapped or encoders count backwards", advice
    if placed and headed:
        degrees = [_with_heading(drive, np.pi / 180) for drive in drives]
        yield degrees, "column phi is in degrees", "multiply it by pi/180"
        compass = [_with_heading(drive, -np.pi / 180, np.pi / 2) for drive in drives]
        yield compass, "column phi is in degrees, clockwise", "give pi/2 - phi pi/180"
        for others in (
            [_with_heading(drive, -1.0) for drive in drives],
            [_with_heading(drive, -1.0, np.pi / 2) for drive in drives],
            [replace(drive, pose=drive.pose[:, [1, 0, 2]]) for drive in drives],
            [replace(drive, pose=drive.pose * [1, -1, 1]) for drive in drives],
        ):
            turn = (
                "change its sign, or, if the wheels turn as it does, exchange x and y or "
                "change the sign of y"
            )
            yield others, "column phi runs clockwise by the course of x and y", turn


def _with_heading(drive: Drive, factor: float, offset: float = 0.0) -> Drive:
    """The drive with each heading replaced by offset + factor * heading."""
    pose, known = drive.pose.copy(), np.isfinite(drive.pose[:, 2])
    pose[known, 2] = np.unwrap(offset + factor * pose[known, 2])
    return replace(drive, pose=pose)


def matches_of(window: Window) -> Array:
    """Correlations between wheels and poses while the wheels move: of unsigned distances, distances
    and turns.
    """
    matches, least = list[float](), 0.05  # [m or rad] in a window
    if np.isfinite(window.moved).sum() >= FEW and rms(window.distance) > least:
        matches.append(_alike(np.abs(window.moved), np.abs(window.distance)))
        if (window.moved.imag != 0).any():  # with headings
            matches.append(_alike(window.moved, window.distance))
    if np.isfinite(window.turned).sum() >= FEW and rms(window.turn) > least:
        matches.append(_alike(window.turned, window.turn))
    return np.array(matches)


def _alike(first: np.ndarray, second: np.ndarray) -> float:
    """Correlation of two motions about zero, or its real part for complex motions; NaN are left
    out.
    """
    known = np.isfinite(first) & np.isfinite(second)
    size = rms(first[known]) * rms(second[known])
    return float(np.mean(first[known] * second[known]).real / size) if size > 0 else 0.0


def refuse_units(drives: Sequence[Drive], gains: Gains, geometry: RobotGeometry) -> None:
    """Refuse a speed gain that matches a wrong unit; degrees of longitude shrink with the cosine of
    the latitude.
    """
    if gains.speed is None:
        return
    value, place = abs(gains.speed.value), np.concatenate([drive.pose[:, :2] for drive in drives])
    x, y = np.nanmean(place, axis=0)
    latitude = min(max(abs(x), abs(y)), 80.0)  # at most: either x or y may be the latitude
    # metres per degree of latitude
    if 0.8 <= 111_320.0 * value <= 1.2 / np.cos(np.radians(latitude)):
        raise LogError(
            f"x and y (about {x:.6g}, {y:.6g}) look like degrees of longitude and latitude: give "
            "metres in a plane, "
            "x = 111320 cos(lat) (lon - lon0) and y = 111320 (lat - lat0)"
        )
    wheels, radius = "omega_l and omega_r look like", geometry.sprocket_radius
    units = {
        np.radians(1): f"{wheels} deg/s: multiply them by pi/180",
        2 * np.pi / 60: f"{wheels} rpm: multiply them by 2 pi/60",
        2 * np.pi: f"{wheels} turns per second: multiply them by 2 pi",
        1 / radius: f"{wheels} m/s: divide them by sprocket_radius = {radius:g} m",
        1e-3 / radius: f"{wheels} mm/s: divide them by sprocket_radius = {1000 * radius:g} mm",
        1000.0: "x and y look like mm: divide them by 1000",
        100.0: "x and y look like cm: divide them by 100",
        1e-3: "t looks like ms: divide it by 1000",
        1e-6: "t looks like µs: divide it by 1e6",
        1e-9: "t looks like ns: divide it by 1e9",
    }
    near = {
        unit: line
        for unit, line in units.items()
        if abs(unit - 1) > 0.2 and abs(value / unit - 1) <= _EXACTLY
    }
    if near:
        times = " or ".join(f"{unit:.4g}" for unit in near)
        raise LogError(
            f"the poses move {value:.4g} times as far as the wheels ({times}): "
            f"{', or '.join(near.values())}"
        )
