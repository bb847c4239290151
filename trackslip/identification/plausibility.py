"""Implausible samples and drives: wrong units, signs and gears, with a guess at the cause."""

from __future__ import annotations

from collections.abc import Collection, Sequence

import numpy as np

from trackslip.doubts import refuse
from trackslip.identification.drives import PreparedDrive, reckoned
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
_COMPARED = 1.0  # over which ways are compared [s]
_MIN_WINDOWS = 5
_KEPT_WAY = (0.2, 3.0)  # plausible ratios of measured to commanded ways
_BACKWARDS = -0.3  # ratio below which a robot drives the other way round
_TURN_LIMIT = 5.0  # largest plausible ratio of measured to commanded turns
_MIN_SHARE = 0.1  # rms commanded way of a window, in half gauges, below which the robot only spins


def require_plausible(
    omega: Array,
    twist: Array,
    slip: Array,
    geometry: RobotGeometry,
    run: Sequence[str],
    yaw_stderr: Array,
    accept: Collection[str] = (),
) -> None:
    """Raise LogError for samples (n, 2) with implausible slip, or that turn in the wrong direction.

    A robot may lose much of its yaw rate, and its inner track may even be dragged forwards: what moves as commanded to
    within what friction can do is plausible. `yaw_stderr` (n,) is the standard error of the yaw rate [rad/s].
    """
    size = np.abs(omega)
    if (k := _first(size.max(axis=1) == 0)) is not None:
        refuse("still", run=run[k])
    ideal = body_twist(omega, 0.0, geometry)
    fastest = geometry.sprocket_radius * size.max(axis=1)  # (n,) [m/s]
    suspicious = ~_as_commanded(ideal, twist, geometry.half_gauge, fastest)
    speed = track_speeds(twist, geometry.half_gauge)  # (n, 2)
    swift = np.abs(speed) > _SWIFT * np.abs(speed).max(axis=1, keepdims=True)
    against = (slip > 1) & (slip < _TWICE) & swift & suspicious[:, None]
    if (k := _first(against.sum(axis=1) == 1)) is not None:
        track = int(np.argmax(against[k]))
        says, side = geometry.sprocket_radius * omega[k, track], ("left", "right")[track]
        refuse("encoder", accept, run[k], side=side, v=speed[k, track], says=says)
    of_faster = slip[np.arange(len(slip)), size.argmax(axis=1)]
    wild = (np.abs(of_faster) > _WILD) & suspicious
    opposite = (ideal[:, 1] * twist[:, 1] < 0) & (np.abs(twist[:, 1]) > 0.2 * np.abs(ideal[:, 1]))
    reversed_turn = opposite & wild & (np.abs(twist[:, 1]) < 2 * np.abs(ideal[:, 1]))
    if (k := _first(wild & ~reversed_turn.any())) is not None:
        radius, guess = geometry.sprocket_radius, unit_guess(ideal[k], twist[k])
        refuse("slip", accept, run[k], guess, slip=of_faster[k], most=_WILD, radius=radius)
    relevant = geometry.half_gauge * np.abs(twist[:, 1] - ideal[:, 1]) > _ASIDE * fastest
    backwards = opposite & relevant & (np.abs(twist[:, 1]) > _SIGNIFICANT * yaw_stderr)
    if (k := _first(backwards)) is not None:
        refuse("turn", accept, run[k], w=twist[k, 1], says=ideal[k, 1])


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
    return gear if 0 < v < _KEPT_WAY[0] else ""  # beyond, wheels may spin on ice


def require_units(drives: Sequence[PreparedDrive], geometry: RobotGeometry) -> None:
    """Raise LogError if the poses move or turn much farther or less far than the sprockets drive, or the other way."""
    parts = [_ways(drive, geometry) for drive in drives]
    real, commanded = (np.concatenate(part) for part in zip(*parts, strict=True))
    if len(real) < _MIN_WINDOWS or np.sqrt(np.mean(commanded[:, 0] ** 2)) < _MIN_SHARE * geometry.half_gauge:
        return
    way = _ratio(real[:, 0], commanded[:, 0])
    known = np.isfinite(real[:, 1])
    turn = _ratio(real[known, 1], commanded[known, 1]) if known.any() else 1.0
    if way < _BACKWARDS:
        refuse("backwards", drives[0].accept)
    elif _KEPT_WAY[0] <= way <= _KEPT_WAY[1] and turn <= _TURN_LIMIT:
        return
    wrong = f"turn {turn:.3g} times as far" if _KEPT_WAY[0] <= way <= _KEPT_WAY[1] else f"move {way:.3g} times as far"
    guess = unit_guess(np.ones(2), np.array([way, turn]))
    refuse("ways", drives[0].accept, guess=guess, wrong=wrong, radius=geometry.sprocket_radius)


def least_squares_gains(drives: Sequence[PreparedDrive], geometry: RobotGeometry) -> tuple[float, float]:
    """Factors on commanded ways and turns that fit the measured ones in least squares; NaN where none can be found."""
    real, commanded = (np.concatenate(part) for part in zip(*(_ways(drive, geometry) for drive in drives), strict=True))
    with np.errstate(invalid="ignore"):
        speed, turn = np.sum(real * commanded, axis=0) / np.sum(commanded**2, axis=0)
    return float(speed), float(turn)


def _ratio(real: Array, commanded: Array) -> float:
    """Ratio of measured to commanded values (n,), 1 if nothing is commanded.

    Of the one in least squares, which a jump of the poses spoils, and the median, the one that is nearer to 1.
    """
    weight = np.abs(commanded)
    if not weight.any():
        return 1.0
    ratio = np.divide(real, commanded, out=np.zeros(len(real)), where=weight > 0)
    order = np.argsort(ratio)
    median = ratio[order][np.searchsorted(np.cumsum(weight[order]), weight.sum() / 2)]
    return float(min(median, real @ commanded / (commanded @ commanded), key=lambda one: abs(one - 1)))


def _ways(drive: PreparedDrive, geometry: RobotGeometry) -> tuple[Array, Array]:
    """Measured and commanded ways [m] and turns [rad] (n, 2) in windows; without headings, sizes of ways and NaN."""
    v = body_twist(drive.omega, 0.0, geometry)[:, 0]
    driven = np.concatenate([[0.0], np.cumsum(v * np.diff(drive.edges))])
    rows = np.flatnonzero(np.isfinite(drive.pose).all(axis=1) if drive.has_heading else np.isfinite(drive.pose[:, 0]))
    if len(rows) < 2:
        return np.zeros((0, 2)), np.zeros((0, 2))
    z, phi = drive.pose[rows, 0] + 1j * drive.pose[rows, 1], drive.pose[rows, 2]
    ends = np.arange(0, len(rows), max(1, round(_COMPARED / drive.interval)))
    turned = np.diff(reckoned(drive, geometry, 1.0, drive.time[rows[ends]])[1])
    way = np.diff(np.interp(drive.time[rows[ends]], drive.edges, driven))
    if not drive.has_heading:
        unknown = np.full(len(way), np.nan)
        return np.column_stack([np.abs(np.diff(z[ends])), unknown]), np.column_stack([np.abs(way), turned])
    forward = np.concatenate([[0.0], np.cumsum((np.diff(z) * np.exp(-0.5j * (phi[1:] + phi[:-1]))).real)])
    return np.column_stack([np.diff(forward[ends]), np.diff(phi[ends])]), np.column_stack([way, turned])
