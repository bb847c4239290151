"""What columns hold instead of what they should: zeros, angles, other units, swapped sides; each refused in a line."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import product

import numpy as np

from trackslip.errors import LogError, counted
from trackslip.identification.gains import Gains, Window, rms, windows_of
from trackslip.identification.preparation import PreparedDrive
from trackslip.kinematics import Array, RobotGeometry, wrap_angle

_EXACTLY = 0.05  # error of a gain within which it is that of a unit: off ice, tracks lose no more of a distance
_CLEARLY = 0.8  # correlation that leaves no doubt; wrong sides reach 0.6 on drives of two minutes (test_misread)
_BETTER = 0.2  # correlation by which another reading must be better, in sum
_FEWEST = 5  # windows that are compared, rows that are a habit
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
_SIGNS = {(-1, 1): ("omega_l", "left"), (1, -1): ("omega_r", "right"), (-1, -1): ("omega_l and omega_r", "both")}
_DEGREE = 111_320.0  # of latitude, mean [m]


def refuse_cells(drive: PreparedDrive) -> None:
    """Refuse zeros in cells that should be empty, and readings that no wheel reaches: a counter began anew."""
    wheels, zero = (drive.omega == 0).all(axis=1), (np.nan_to_num(drive.pose) == 0).all(axis=1)
    poses = "x, y and phi" if drive.has_heading else "x and y"
    for names, still, measured in (
        (poses, zero, "pose was measured"),
        ("omega_l and omega_r", wheels, "encoder was read"),
    ):
        alone = int(((still[1:-1] != still[:-2]) & (still[1:-1] != still[2:])).sum())
        if alone > max(_FEWEST, 0.1 * len(still)):
            raise LogError(
                f"run {drive.name!r}: columns {names} go to 0 and back {alone:,} times: leave cells empty where no "
                f"{measured}"
            )
    for name, speed in zip(("omega_l", "omega_r"), np.abs(drive.omega).T, strict=True):
        around = np.maximum(np.append(0.0, speed[:-1]), np.append(speed[1:], 0.0))
        usual = np.maximum(np.quantile(speed, 0.99), around)
        wild = np.flatnonzero((speed > 20 * usual) & (speed > 100.0))
        if len(wild):
            k = int(wild[0])
            raise LogError(
                f"run {drive.name!r}: column {name} is {speed[k]:.3g} rad/s at t = {drive.edges[k + 1]:.12g} s, "
                f"{speed[k] / usual[k]:.0f} times its usual speed ({counted(len(wild), 'row')}): if its counter began "
                "anew there, unwrap the ticks; else leave the cell empty"
            )


def refuse_readings(drives: Sequence[PreparedDrive], geometry: RobotGeometry, clock: float) -> None:
    """Refuse columns by which wheels and poses match much better if they are read otherwise."""
    window = windows_of(drives, geometry, clock)
    now = matches_of(window)
    if now.min(initial=1.0) > _CLEARLY:
        return
    ways = [
        (matches_of(windows_of(others, geometry, clock)), what, advice)
        for others, what, advice in _other_readings(drives)
    ]
    match, what, advice = max(ways, key=lambda way: float(way[0].sum()))
    if match.sum() > now.sum() + _BETTER and match.mean() > _CLEARLY:
        raise LogError(f"{what} (wheels and poses correlate by {now.mean():.2f}, else by {match.mean():.2f}): {advice}")
    phi = np.concatenate([drive.pose[:, 2] for drive in drives])
    if np.abs(phi).max() <= 1.01 and np.ptp(np.cumsum(window.turn)) > 2 * np.pi:
        raise LogError("column phi, from -1 to 1, looks like the z of a quaternion: give phi = 2 atan2(z, w)")


def _other_readings(drives: Sequence[PreparedDrive]) -> Iterator[tuple[list[PreparedDrive], str, str]]:
    """The drives as other readings of their columns have them, what these would mean, and what to do then."""
    placed, headed = (any(np.isfinite(drive.pose[:, k]).any() for drive in drives) for k in (0, 2))
    for swapped, signs in [*product((False, True), ((1, 1), *_SIGNS))][1:]:
        steps = ["change the sign of {}, for a bag by --reversed {}".format(*_SIGNS[signs])] if signs in _SIGNS else []
        advice = ", then ".join([*steps, "exchange omega_l and omega_r"] if swapped else steps)
        if signs[0] == signs[1] and not (placed and headed):  # positions or headings alone don't tell these apart
            advice = "exchange omega_l and omega_r, or change the signs of both if they count backwards"
        elif swapped and signs == (-1, -1):
            advice += ", or turn phi by pi"
        others = [replace(drive, omega=(drive.omega * signs)[:, :: -1 if swapped else 1]) for drive in drives]
        yield others, "tracks are swapped or encoders count backwards", advice
    most = max(float(np.abs(drive.omega).max()) for drive in drives)
    angles = f"columns omega_l and omega_r look like angles (up to {most:.3g}), not speeds"
    yield [_by_differences(drive) for drive in drives], angles, "give their changes over time, in rad/s"
    if placed and headed:
        degrees = [_with_heading(drive, np.pi / 180) for drive in drives]
        yield degrees, "column phi is in degrees", "multiply it by pi/180"
        for others in (
            [_with_heading(drive, -1.0) for drive in drives],
            [_with_heading(drive, -1.0, np.pi / 2) for drive in drives],
            [replace(drive, pose=drive.pose[:, [1, 0, 2]]) for drive in drives],
        ):
            turn = "change its sign, or exchange x and y if the wheels turn as it does"
            yield others, "column phi runs clockwise by the course of x and y", turn


def _by_differences(drive: PreparedDrive) -> PreparedDrive:
    """The drive whose speeds are the changes of angles."""
    change = np.diff(drive.omega, axis=0, prepend=drive.omega[:1])
    wraps = np.ptp(drive.omega) <= 2 * np.pi * (1 + _EXACTLY)
    return replace(drive, omega=(wrap_angle(change) if wraps else change) / np.diff(drive.edges)[:, None])


def _with_heading(drive: PreparedDrive, factor: float, offset: float = 0.0) -> PreparedDrive:
    """The drive with other headings."""
    pose, known = drive.pose.copy(), np.isfinite(drive.pose[:, 2])
    pose[known, 2] = np.unwrap(offset + factor * pose[known, 2])
    return replace(drive, pose=pose)


def matches_of(window: Window) -> Array:
    """Correlations of wheels and poses: of sizes of distances, of distances, of turns, as far as wheels have them."""
    matches, least = list[float](), 0.05  # [m or rad] in a window
    if np.isfinite(window.moved).sum() >= _FEWEST and rms(window.distance) > least:
        matches.append(_alike(np.abs(window.moved), np.abs(window.distance)))
        if (window.moved.imag != 0).any():  # with headings
            matches.append(_alike(window.moved, window.distance))
    if np.isfinite(window.turned).sum() >= _FEWEST and rms(window.turn) > least:
        matches.append(_alike(window.turned, window.turn))
    return np.array(matches)


def _alike(first: np.ndarray, second: np.ndarray) -> float:
    """Correlation around zero of motions, by the real part if they are complex; NaN is left out."""
    known = np.isfinite(first) & np.isfinite(second)
    size = rms(first[known]) * rms(second[known])
    return float(np.mean(first[known] * second[known]).real / size) if size > 0 else 0.0


def refuse_units(drives: Sequence[PreparedDrive], gains: Gains, geometry: RobotGeometry) -> None:
    """Refuse a gain that is that of a unit; degrees of longitude are shorter, by the cosine of the latitude."""
    if gains.speed is None:
        return
    value, place = abs(gains.speed.value), np.concatenate([drive.pose[:, :2] for drive in drives])
    x, y = np.nanmean(place, axis=0)
    latitude = min(max(abs(x), abs(y)), 80.0)  # at most, whichever it is
    if 0.8 <= value * _DEGREE <= 1.2 / np.cos(np.radians(latitude)):
        raise LogError(
            f"x and y (about {x:.6g}, {y:.6g}) look like degrees of longitude and latitude: give metres in a plane, "
            "x = 111320 cos(lat) (lon - lon0) and y = 111320 (lat - lat0)"
        )
    units = _SPEED_UNITS | {
        1 / geometry.sprocket_radius: "omega_l and omega_r look like m/s: divide them by sprocket_radius = "
        f"{geometry.sprocket_radius:g} m"
    }
    near = {unit: line for unit, line in units.items() if abs(unit - 1) > 0.2 and abs(value / unit - 1) <= _EXACTLY}
    if near:
        times = " or ".join(f"{unit:.4g}" for unit in near)
        raise LogError(
            f"the poses move {value:.4g} times as far as the wheels ({times}): {', or '.join(near.values())}"
        )
