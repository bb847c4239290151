"""What columns hold instead of what they should: zeros, angles, other units, swapped sides; each refused in a line."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from trackslip.errors import LogError, counted
from trackslip.identification.gains import Gains, Steps, Window, rms, windows_of
from trackslip.identification.preparation import PreparedDrive
from trackslip.kinematics import Array, RobotGeometry

_EXACTLY = 0.05  # error of a gain within which it is that of a unit: off ice, tracks lose no more of a distance
_CLEARLY = 0.8  # correlation that leaves no doubt; wrong sides reach 0.6 on drives of two minutes (test_misread)
_BETTER = 0.2  # correlation by which another reading must be better, in sum
_FEWEST = 5  # windows that are compared
_SLOW = 0.2  # rms belt speed at which no robot turns so far between poses that its turn is ambiguous [m/s]
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
    """Refuse readings that no wheel reaches: a counter began anew."""
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


def refuse_angles(drives: Sequence[PreparedDrive], geometry: RobotGeometry) -> None:
    """Refuse angles of wheels where speeds belong: the motion follows their differences."""
    by_differences = list[PreparedDrive]()
    for drive in drives:
        change, span = np.diff(drive.omega, axis=0, prepend=drive.omega[:1]), np.ptp(drive.omega, axis=0)
        change -= span * np.round(change / np.maximum(span, 1e-9))  # counters that begin anew
        speeds = change / np.diff(drive.edges)[:, None]
        slow = _SLOW / geometry.sprocket_radius / max(rms(speeds), 1e-9)  # whatever the unit
        by_differences.append(replace(drive, omega=slow * speeds))
    by_speeds, by_angles = (matches_of(windows_of(each, geometry, 0.0)) for each in (drives, by_differences))
    if len(by_angles) and by_angles.mean() > max(_CLEARLY, by_speeds.mean() + _BETTER if len(by_speeds) else 0.0):
        most = max(float(np.abs(drive.omega).max()) for drive in drives)
        raise LogError(
            f"columns omega_l and omega_r look like angles or ticks (up to {most:.3g}), not speeds: the robot moves as "
            "they change: give their changes over time, in rad/s"
        )


def refuse_sides(drives: Sequence[PreparedDrive], geometry: RobotGeometry, clock: float) -> None:
    """Refuse swapped and reversed sides: those with which the wheels would match the poses much better."""

    def matches(swapped: bool, signs: tuple[int, int]) -> Array:
        others = [replace(drive, omega=(drive.omega * signs)[:, :: -1 if swapped else 1]) for drive in drives]
        return matches_of(windows_of(others, geometry, clock))

    now = matches(False, (1, 1))
    if now.min(initial=1.0) > _CLEARLY:
        return
    ways = [(swapped, signs) for swapped in (False, True) for signs in ((1, 1), *_SIGNS)][1:]
    swapped, signs = best = max(ways, key=lambda way: float(matches(*way).sum()))
    match = matches(*best)
    if match.sum() < now.sum() + _BETTER or match.mean() < _CLEARLY:
        return
    steps = []
    if signs in _SIGNS:
        steps.append("change the sign of {}, for a bag by --reversed {}".format(*_SIGNS[signs]))
    if swapped:
        steps.append("exchange omega_l and omega_r")
    advice = ", then ".join(steps)
    placed, headed = (any(np.isfinite(drive.pose[:, k]).any() for drive in drives) for k in (0, 2))
    if signs[0] == signs[1] and not (placed and headed):  # positions or headings alone don't tell these apart
        advice = "exchange omega_l and omega_r, or change the signs of both if they count backwards"
    elif swapped and signs == (-1, -1):
        advice += ", or turn phi by pi"
    raise LogError(
        f"tracks are swapped or encoders count backwards (correlation with the poses {now.mean():.2f}, "
        f"{match.mean():.2f} otherwise): {advice}"
    )


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


def refuse_headings(drive: PreparedDrive, geometry: RobotGeometry, clock: float) -> None:
    """Refuse headings in degrees, clockwise, or the z of a quaternion, by the course of the path."""
    steps = Steps.of(drive, geometry, clock)
    ends = steps.ends(max(0.5, drive.interval))
    if steps.place is None or steps.heading is None or len(ends) < _FEWEST:
        return
    chord = np.diff(steps.place[ends])
    long = np.abs(chord) > max(0.5 * rms(chord), 1e-9)
    phi, direction = ((steps.heading[ends[1:]] + steps.heading[ends[:-1]]) / 2)[long], np.angle(chord[long])
    if len(phi) < _FEWEST:
        return

    def agreement(values: Array) -> float:
        return float(np.abs(np.mean(np.exp(2j * (direction - values)))))

    right = agreement(phi)
    clearly = max(_CLEARLY, right + _BETTER)
    where = f"run {drive.name!r}: column phi (from {phi.min():.3g} to {phi.max():.3g})"
    if right > _CLEARLY:
        return
    if agreement(np.radians(phi)) > clearly:
        raise LogError(f"{where} is in degrees by the course of x and y: multiply it by pi/180")
    if agreement(-phi) > clearly:
        raise LogError(
            f"{where} runs clockwise by the course of x and y: change its sign, or exchange x and y if the wheels turn "
            "as it does"
        )
    if np.abs(phi).max() <= 1.01:
        cosine = 1 - 2 * np.clip(phi, -1, 1) ** 2  # of the heading, whatever the sign of w
        if np.corrcoef(2 * cosine**2 - 1, np.cos(2 * direction))[0, 1] > _CLEARLY:
            raise LogError(f"{where} looks like the z of a quaternion: give phi = 2 atan2(z, w)")


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
