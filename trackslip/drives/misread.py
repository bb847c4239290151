"""Checks whether columns hold what their names say: sides, signs, directions and units.

Columns are read in other ways, each of which mends one mistake: sides exchanged, headings in
degrees, a mirrored y. If another reading makes wheels and poses match far better, the log is
refused with the name of the column. If none can be told from the log as it is, the check says so.

Poses that are close together are compared in windows, by correlations. Between poses that are far
apart, the path of the wheels is integrated and fitted to the relative motions.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import product
from typing import Final

import numpy as np

from trackslip.drives.checks import Check, Verdict
from trackslip.drives.conditioning import FEW
from trackslip.drives.drive import Drive, Drives
from trackslip.drives.gains import WINDOW, Gains, Window, rms_of_known, windows_of
from trackslip.drives.relative_motions import RelativeFit, RelativeMotions, fitted
from trackslip.errors import LogError, counted
from trackslip.kinematics import Array, RobotGeometry

# largest relative deviation of a gain from a wrong unit's factor: tracks slip no more, except on
# ice
_EXACTLY: Final = 0.05
# the same for units of x and y if turns show that those of omega are right
_ROUGHLY: Final = 0.2
# least correlation that leaves no doubt; swapped sides reach 0.6 in two-minute drives
_CLEARLY: Final = 0.8
# least increase in the sum of the correlations for which another reading counts as better
_BETTER: Final = 0.2
# least increase in the log-likelihood of relative motions for which another reading counts as
# better; right readings of drives with 10 % of slip are ahead of all others by 7 or more
_LIKELIER: Final = 6.0
# least share of relative motions that a reading explains if it leaves no doubt
_MOSTLY: Final = 0.5
_SETTLED: Final = 0.85  # least share of relative motions that the log as it is explains, if right
_HARDLY: Final = 0.3  # share of explained motions below which wheels and poses don't go together
_MOVING: Final = 0.05  # least rms of the wheels' motions in windows that tell anything [m or rad]
_UNEQUAL: Final = 0.05  # largest relative difference between the radii of both sides
# rms belt speed at which no robot turns by an ambiguous angle between two poses [m/s]
_SLOW: Final = 0.2
# ratio of turns in degrees to those of the wheels: a robot turns as far as its wheels, or less
_DEGREES: Final = 3.0
# ratios of the gain of turns to that of distances, of any robot: its separation multiplier is 0.8
# to 5
_TURN_RATIOS: Final = (0.2, 1.25)
_QUATERNION: Final = (0.9, 1.01)  # limits on the largest z of a quaternion, with rounding
_PER_DEGREE: Final = 111_320.0  # metres per degree of latitude
_EXTENT: Final = 0.1  # largest extent of a drive: 10 km [degrees]
_HIGHEST_LATITUDE: Final = 80.0  # highest latitude at which robots drive [degrees]
# least ratio of distances to those of the belts, of a robot that doesn't turn in place
_AS_FAR: Final = 0.6
_TURNED_IN_PLACE: Final = 0.3  # least turn, in a window, of a robot that turns in place [rad]
# share of windows with wrong signs, above which these aren't wild headings
_LEAST_WITHOUT_SIGN: Final = 0.05
# share of rows with new speeds above which these are no commands that are held for a second
_HELD_ROWS: Final = 0.1


def refuse_cells(drive: Drive) -> None:
    """Refuse single speeds that no wheel reaches, such as those from a counter that restarts."""
    for name, column in zip(("omega_l", "omega_r"), drive.omega.T, strict=True):
        speed = np.abs(column)
        before = np.append(0.0, speed[:-1])
        after = np.append(speed[1:], 0.0)
        usual = np.maximum(np.quantile(speed, 0.99), np.maximum(before, after))
        wild = np.flatnonzero((speed > 20 * usual) & (speed > 100.0))
        if not len(wild):
            continue
        k = int(wild[0])
        cell = f"column {name} is {speed[k]:.3g} rad/s at t = {drive.edges[k + 1]:.12g} s"
        times = f"{speed[k] / usual[k]:.0f} times its usual speed"
        raise LogError(
            f"run {drive.name!r}: {cell}, {times} ({counted(len(wild), 'row')}): if its counter "
            "began anew there, unwrap the ticks; else leave the cell empty"
        )


@dataclass(frozen=True)
class Evidence:
    """How well wheels and poses match if columns are read in some way."""

    score: float  # another reading counts as better if its score is higher by 1
    clear: bool  # true if the match leaves no doubt
    figure: str  # the match in words: by 0.93


@dataclass(frozen=True)
class Matching:
    """How well wheels and poses of drives match as they were logged."""

    windows: Window  # motion in windows
    matches: Array  # (m,) `matches_of` the windows
    turning: float  # motion of the belts in turns, relative to that of the robot
    far: RelativeFit | None  # the fit to relative motions, if poses are far apart
    other_unit: RelativeFit | None  # the same with a wrong unit of omega, if that is likelier
    evidence: Evidence | None  # None if the log has none
    spacing: str  # the number of poses and their distance in time, in words

    @classmethod
    def of(cls, drives: Sequence[Drive], geometry: RobotGeometry, clock: float) -> Matching:
        """Compare wheels and poses of drives."""
        windows = windows_of(Drives.of(drives), geometry, clock)
        matches = matches_of(windows)
        turning = (
            geometry.half_gauge
            * rms_of_known(windows.turn)
            / max(rms_of_known(windows.distance), 1e-9)
        )
        interval = float(np.median([drive.interval for drive in drives]))
        poses = counted(sum(len(drive.time) for drive in drives), "pose")
        spacing = f"{poses}, {interval:.3g} s apart"
        if not are_rare(drives):
            return cls(windows, matches, turning, None, None, _of_windows(matches), spacing)
        motions = RelativeMotions.of(drives, clock)
        far = fitted(motions, geometry)
        unit = _in_other_unit(motions, geometry, far)
        return cls(windows, matches, turning, far, unit, _of_relative_motions(far), spacing)

    @property
    def settled(self) -> bool:
        """True if nothing is misread: all quantities match, or the motions are those of a robot
        that can exist.
        """
        if self.far is not None:
            return self.far.explained >= _SETTLED
        return len(self.matches) > 0 and float(self.matches.min()) > _CLEARLY

    @property
    def goes_together(self) -> bool | None:
        """False if wheels and poses hardly go together; None if it can't be told."""
        far = self.other_unit or self.far
        if far is not None:
            return far.explained >= _HARDLY
        return float(np.abs(self.matches).mean()) >= 0.5 if len(self.matches) else None

    @property
    def turns_tell(self) -> bool:
        """True if the wheels turn the robot by more than unequal radii may."""
        return rms_of_known(self.windows.turn) > _MOVING and self.turning > _UNEQUAL

    @property
    def varies(self) -> bool:
        """True if the motion of the wheels varies within blocks of driving."""
        _, block = np.unique(self.windows.block, return_inverse=True)
        return any(
            float(np.sqrt(np.mean(_from_means(motion, block) ** 2))) > _MOVING
            for motion in (self.windows.distance, self.windows.turn)
            if len(motion)
        )

    @property
    def why_unknown(self) -> str:
        """Why a check can't be told from the log."""
        if self.far is not None or self.evidence is None:
            return self.spacing
        if rms_of_known(self.windows.turn) <= _MOVING:
            return "the robot hardly turns"
        if rms_of_known(self.windows.distance) <= _MOVING:
            return "the robot hardly drives"
        return "the poses hardly follow the wheels" if self.varies else "the motion hardly varies"


def _from_means(values: Array, block: np.ndarray) -> Array:
    """Values (n,) minus the mean of all in the same `block` (n,), numbered from 0 without gaps."""
    mean = np.bincount(block, np.nan_to_num(values)) / np.bincount(block)
    return np.nan_to_num(values) - mean[block]


def _in_other_unit(
    motions: RelativeMotions, geometry: RobotGeometry, fit: RelativeFit | None
) -> RelativeFit | None:
    """The likeliest fit to relative motions with a wrong unit of omega; None if `fit`, that to the
    log as it is, is as likely or explains the motions.
    """
    if fit is None or fit.explained >= _SETTLED:
        return None
    units = [unit for unit in _units(geometry) if unit.of_speeds]
    others = [fitted(motions, geometry, unit.factor) for unit in units]
    likelier = [other for other in others if other and other.loss < fit.loss - _LIKELIER]
    return min(likelier, key=lambda other: other.loss, default=None)


def are_rare(drives: Sequence[Drive]) -> bool:
    """True if most drives have no two poses in a window."""
    return float(np.median([drive.interval for drive in drives])) > WINDOW


def _evidence(
    drives: Sequence[Drive], geometry: RobotGeometry, clock: float, rare: bool
) -> Evidence | None:
    """Evidence for a reading of drives; None if there is none."""
    if rare:
        return _of_relative_motions(fitted(RelativeMotions.of(drives, clock), geometry))
    return _of_windows(matches_of(windows_of(Drives.of(drives), geometry, clock)))


def _of_windows(matches: Array) -> Evidence | None:
    """Evidence from correlations (m,) in windows."""
    if not len(matches):
        return None
    mean = float(matches.mean())
    return Evidence(float(matches.sum()) / _BETTER, mean > _CLEARLY, f"by {mean:.2f}")


def _of_relative_motions(fit: RelativeFit | None) -> Evidence | None:
    """Evidence from a fit to relative motions."""
    if fit is None:
        return None
    figure = f"in {100 * fit.explained:.0f} % of motions"
    return Evidence(-fit.loss / _LIKELIER, fit.explained >= _MOSTLY, figure)


def reading_checks(
    drives: Sequence[Drive], now: Matching, geometry: RobotGeometry, clock: float
) -> list[Check]:
    """Check whether another reading of the columns matches better than the log as it is."""
    rare = are_rare(drives)
    evidence = now.evidence
    of_sprockets = [_angles(drives, geometry), _sums(drives)]
    readings = [*of_sprockets, *_other_readings(drives, now)]
    if not rare and now.settled and rms_of_known(now.windows.turn) > _MOVING:
        # distances and turns match to both sides, as by no other reading
        return [Check(reading.subject, Verdict.HOLDS) for reading in _one_each(readings)]
    score = evidence.score if evidence is not None else 0.0
    found = [_evidence(reading.drives, geometry, clock, rare) for reading in readings]
    scores = np.array([-np.inf if other is None else other.score for other in found])

    # where nothing matches as logged, because the robot doesn't move by its wheels, only angles do
    rivals = scores if evidence is not None else scores[: len(of_sprockets)]
    best = int(np.argmax(rivals))
    other = found[best]
    unit = _of_relative_motions(now.other_unit)
    least = max(score, unit.score if unit is not None else -np.inf) + 1
    if other is not None and other.clear and scores[best] > least and not now.settled:
        before = evidence.figure if evidence is not None else "by 0.00"
        agree = "agree" if rare else "correlate"
        figures = f"wheels and poses {agree} {before} as logged, {other.figure} if corrected"
        line = f"{readings[best].what} ({figures}): {readings[best].advice}"
        # what explains the log as well
        other_advice = {
            reading.subject: f", or, if {reading.what}, {reading.advice}"
            for k, reading in enumerate(readings)
            if reading.subject != readings[best].subject and scores[k] > scores[best] - 1
        }
        line += "".join(other_advice.values())
        return [Check(readings[best].subject, Verdict.FAILS, line)]

    checks = list[Check]()
    for subject in (reading.subject for reading in _one_each(readings)):
        of_subject = [k for k, reading in enumerate(readings) if reading.subject == subject]
        worse = evidence is not None and all(scores[k] < score - 1 for k in of_subject)
        if worse:
            checks.append(Check(subject, Verdict.HOLDS))
        else:
            checks.append(Check(subject, Verdict.UNKNOWN, now.why_unknown))
    return [*checks, *_quaternion_check(drives, now, geometry)]


def _quaternion_check(
    drives: Sequence[Drive], now: Matching, geometry: RobotGeometry
) -> list[Check]:
    """Check that phi isn't the z of a quaternion; empty if it isn't within -1 to 1."""
    phi = np.concatenate([drive.pose[:, 2] for drive in drives])
    clear = now.evidence is not None and now.evidence.clear
    if clear or not np.isfinite(phi).any():
        return []
    # a robot that turns by a circle has every z
    low, high = _QUATERNION
    if not low <= np.nanmax(np.abs(phi)) <= high:
        return []
    for drive in drives:
        left, right = drive.angles(drive.edges) * geometry.sprocket_radius
        turn = (right - left) / (2 * geometry.half_gauge)
        if np.ptp(turn) > 2 * np.pi:
            looks = "column phi, from -1 to 1, looks like the z of a quaternion"
            line = f"{looks}: give phi = 2 atan2(z, w)"
            return [Check("headings", Verdict.FAILS, line)]
    return []


def _one_each(readings: Sequence[_Reading]) -> list[_Reading]:
    """The last reading of each subject."""
    return list({reading.subject: reading for reading in readings}.values())


@dataclass(frozen=True)
class _Reading:
    """Drives with reinterpreted columns."""

    subject: str  # what the reading checks
    drives: list[Drive]
    what: str  # the mistake, if these match better
    advice: str  # the remedy


def _angles(drives: Sequence[Drive], geometry: RobotGeometry) -> _Reading:
    """Reinterpret the speed columns as angles or counters that may wrap: speeds are their scaled
    changes.
    """
    others = []
    for drive in drives:
        change = np.diff(drive.omega, axis=0, prepend=drive.omega[:1])
        span = np.ptp(drive.omega, axis=0)
        change -= span * np.round(change / np.maximum(span, 1e-9))
        speeds = change / np.diff(drive.edges)[:, None]
        scale = _SLOW / geometry.sprocket_radius / max(rms_of_known(speeds), 1e-9)
        others.append(replace(drive, omega=scale * speeds))
    most = max(float(np.abs(drive.omega).max()) for drive in drives)
    what = f"columns omega_l and omega_r look like angles or ticks (up to {most:.3g}), not speeds"
    return _Reading("speeds of sprockets", others, what, "give their changes over time, in rad/s")


def _sums(drives: Sequence[Drive]) -> _Reading:
    """Reinterpret the readings of which speeds were computed as changes since the reading before,
    which only their sums are angles of.
    """
    others = []
    for drive in drives:
        duration = np.diff(drive.edges)[:, None]
        readings = np.cumsum(drive.omega * duration, axis=0)
        # a sprocket that stands, as it often does, has no change
        readings -= [_most_frequent(side) for side in readings.T]
        others.append(replace(drive, omega=readings / duration))
    return _Reading(
        "speeds of sprockets",
        others,
        "the columns of ticks or angles look like changes since the last reading",
        "give their running sums",
    )


def _most_frequent(values: Array) -> float:
    """The most frequent of values (n,), but for rounding."""
    rounded, counts = np.unique(values.round(6), return_counts=True)
    return float(rounded[counts.argmax()])


def _other_readings(drives: Sequence[Drive], now: Matching) -> Iterator[_Reading]:
    """Yield reinterpretations of drives: swapped sides, changed signs and other headings."""
    placed = any(np.isfinite(drive.pose[:, 0]).any() for drive in drives)
    headed = any(np.isfinite(drive.pose[:, 2]).any() for drive in drives)
    yield from _other_sides(drives, has_poses=placed and headed)
    if placed and headed:
        yield from _other_directions(drives)
    if placed and headed and _may_be_degrees(drives, now):
        degrees = [_with_heading(drive, np.pi / 180) for drive in drives]
        what = "column phi is in degrees"
        yield _Reading("unit of headings", degrees, what, "multiply it by pi/180")
        compass = [_with_heading(drive, -np.pi / 180, np.pi / 2) for drive in drives]
        what = "column phi is in degrees, clockwise"
        yield _Reading("unit of headings", compass, what, "give pi/2 - phi pi/180")


def _other_sides(drives: Sequence[Drive], has_poses: bool) -> Iterator[_Reading]:
    """Yield drives with swapped sides and changed signs; `has_poses` is true for positions with
    headings.
    """
    names = {
        (-1, 1): ("omega_l", "left"),
        (1, -1): ("omega_r", "right"),
        (-1, -1): ("omega_l and omega_r", "both"),
    }
    for swapped, signs in product((False, True), ((1, 1), *names)):
        both_signs = signs[0] == signs[1]
        as_logged = not swapped and signs == (1, 1)
        # positions or headings alone don't tell forwards from backwards
        looks_as_logged = not has_poses and swapped and signs == (-1, -1)
        if as_logged or looks_as_logged:
            continue
        steps = list[str]()
        if signs in names:
            column, side = names[signs]
            steps.append(f"change the sign of {column}, for a bag by --reversed {side}")
        if swapped:
            steps.append("exchange omega_l and omega_r")
        advice = ", then ".join(steps)
        if both_signs and not has_poses:
            advice = (
                "exchange omega_l and omega_r, or change the signs of both if they count backwards"
            )
        elif swapped and signs == (-1, -1):
            advice += ", or turn phi by pi (--sensor X Y 3.14159 if the sensor looks backwards)"
        elif swapped and signs == (1, 1):
            advice += ", or change the signs of y and phi if phi runs clockwise"
        order = [1, 0] if swapped else [0, 1]
        others = [replace(drive, omega=(drive.omega * signs)[:, order]) for drive in drives]
        what = "tracks are swapped or encoders count backwards"
        yield _Reading("sides of the tracks", others, what, advice)


def _other_directions(drives: Sequence[Drive]) -> Iterator[_Reading]:
    """Yield drives with headings to the other side, and with mirrored positions."""
    clockwise = "column phi runs clockwise by the wheels and the course of x and y"
    subject = "direction of headings"
    turned = [_with_heading(drive, -1.0) for drive in drives]
    yield _Reading(subject, turned, clockwise, "change its sign")
    compass = [_with_heading(drive, -1.0, np.pi / 2) for drive in drives]
    yield _Reading(subject, compass, clockwise, "give pi/2 - phi")

    mirrored = "columns x and y are mirrored by the wheels and phi, or phi runs clockwise by them"
    subject = "axes of positions"
    exchanged = [replace(drive, pose=drive.pose[:, [1, 0, 2]]) for drive in drives]
    yield _Reading(subject, exchanged, mirrored, "exchange x and y")
    others = [replace(drive, pose=drive.pose * [1, -1, 1]) for drive in drives]
    yield _Reading(subject, others, mirrored, "change the sign of y")


def _may_be_degrees(drives: Sequence[Drive], now: Matching) -> bool:
    """True if headings change so much that they may be in degrees."""
    phi = np.concatenate([drive.pose[:, 2] for drive in drives])
    if not np.nanmax(phi) - np.nanmin(phi) > 2 * np.pi:
        return False
    turned = np.abs(now.windows.turned)
    known = np.isfinite(turned)
    if now.far is not None or not known.any():
        return True
    wheels = float(np.mean(np.abs(now.windows.turn[known])))
    return bool(np.mean(turned[known]) > _DEGREES * wheels)


def _with_heading(drive: Drive, factor: float, offset: float = 0.0) -> Drive:
    """The drive with each heading replaced by offset + factor * heading."""
    pose = drive.pose.copy()
    known = np.isfinite(pose[:, 2])
    pose[known, 2] = np.unwrap(offset + factor * pose[known, 2])
    return replace(drive, pose=pose)


def matches_of(window: Window) -> Array:
    """Correlations between wheels and poses while the wheels move: of unsigned distances, distances
    and turns.
    """
    matches = list[float]()
    if np.isfinite(window.moved).sum() >= FEW and rms_of_known(window.distance) > _MOVING:
        matches.append(_alike(np.abs(window.moved), np.abs(window.distance)))
        with_headings = bool((window.moved.imag != 0).any())
        if with_headings:
            matches.append(_alike(window.moved, window.distance))
    if np.isfinite(window.turned).sum() >= FEW and rms_of_known(window.turn) > _MOVING:
        matches.append(_alike(window.turned, window.turn))
    return np.array(matches)


def _alike(first: np.ndarray, second: np.ndarray) -> float:
    """Correlation of two motions about zero, or its real part for complex motions; NaN are left
    out.
    """
    known = np.isfinite(first) & np.isfinite(second)
    size = rms_of_known(first[known]) * rms_of_known(second[known])
    return float(np.mean(first[known] * second[known]).real / size) if size > 0 else 0.0


@dataclass(frozen=True)
class _Unit:
    """A wrong unit of a column."""

    factor: float  # how much farther the poses seem to move by it than the wheels
    line: str  # the column, its unit and the remedy
    of_speeds: bool = False  # true if it is a unit of omega
    of_positions: bool = False  # true if turns are as in the right unit


@dataclass(frozen=True)
class Ratios:
    """Ratios of measured distances and turns to the wheels'; None if unknown."""

    speed: float | None
    turn: float | None

    @classmethod
    def of(cls, now: Matching, gains: Gains) -> Ratios:
        """The ratios from relative motions between poses far apart, else from windows."""
        speed = abs(gains.speed.value) if gains.speed is not None else None
        turn = abs(gains.turn.value) if gains.turn is not None else None
        far = now.other_unit or now.far
        if far is None:
            return cls(speed, turn)
        return cls(far.speed if far.speed is not None else speed, far.turn)


def degrees_check(drives: Sequence[Drive], now: Matching, gains: Gains) -> Check:
    """Check that positions aren't degrees of longitude and latitude, which shrink with the cosine
    of the latitude.
    """
    subject = "positions in metres"
    speed = _unsigned_ratio(now.windows)
    if speed is None:  # no two poses in a window
        speed = Ratios.of(now, gains).speed
    if speed is None:
        return Check(subject, Verdict.UNKNOWN, _why_no_distances(drives, now))
    place = np.concatenate([drive.pose[:, :2] for drive in drives])
    x, y = np.nanmean(place, axis=0)
    extent = float(np.max(np.nanmax(place, axis=0) - np.nanmin(place, axis=0)))
    # at most: either x or y may be the latitude
    latitude = min(max(abs(x), abs(y)), _HIGHEST_LATITUDE)
    highest = 1.2 / np.cos(np.radians(latitude))
    if extent > _EXTENT or not 0.8 <= _PER_DEGREE * speed <= highest:
        return Check(subject, Verdict.HOLDS)
    line = (
        f"x and y (about {x:.6g}, {y:.6g}) look like degrees of longitude and latitude, in either "
        "order: give metres in a plane, x = 111320 cos(lat) (lon - lon0) and y = 111320 (lat - "
        "lat0)"
    )
    return Check(subject, Verdict.FAILS, line)


def _unsigned_ratio(windows: Window) -> float | None:
    """Ratio of the measured distances to the wheels', whatever their directions, as degrees are
    often in the wrong order; None if it is unknown.
    """
    moved = np.abs(windows.moved)
    distance = np.abs(windows.distance)
    known = np.isfinite(moved) & np.isfinite(distance)
    driven = rms_of_known(distance[known])
    if known.sum() < FEW or driven <= _MOVING:
        return None
    return rms_of_known(moved[known]) / driven


def _why_no_distances(drives: Sequence[Drive], now: Matching) -> str:
    """Why the gain of distances isn't known."""
    placed = any(np.isfinite(drive.pose[:, 0]).any() for drive in drives)
    return now.why_unknown if placed else "no positions were measured"


def units_check(
    drives: Sequence[Drive], now: Matching, ratios: Ratios, geometry: RobotGeometry
) -> Check:
    """Check that the gain of distances matches no wrong unit.

    The gain of turns tells units of x and y, on which it doesn't depend, from those of omega and t.
    """
    subject = "units"
    speed = ratios.speed
    if speed is None:
        return Check(subject, Verdict.UNKNOWN, _why_no_distances(drives, now))
    near = [
        unit
        for unit in _units(geometry)
        if abs(unit.factor - 1) > 0.2
        and abs(speed / unit.factor - 1) <= _tolerance(unit, ratios.turn)
        and _turns_agree(unit, speed, ratios.turn)
    ]
    if not near:
        return Check(subject, Verdict.HOLDS)
    factors = " or ".join(f"{unit.factor:.4g}" for unit in near)
    lines = ", or ".join(unit.line for unit in near)
    line = f"the poses move {speed:.4g} times as far as the wheels ({factors}): {lines}"
    return Check(subject, Verdict.FAILS, line)


def _units(geometry: RobotGeometry) -> list[_Unit]:
    """Wrong units that occur in logs."""
    radius = geometry.sprocket_radius
    wheels = "omega_l and omega_r look like"
    of_speeds = {
        np.radians(1): "deg/s: multiply them by pi/180",
        2 * np.pi / 60: "rpm: multiply them by 2 pi/60",
        2 * np.pi: "turns per second: multiply them by 2 pi",
        1 / radius: f"m/s: divide them by sprocket_radius = {radius:g} m",
        1e-3 / radius: f"mm/s: divide them by sprocket_radius = {1000 * radius:g} mm",
    }
    return [
        *(_Unit(factor, f"{wheels} {line}", of_speeds=True) for factor, line in of_speeds.items()),
        _Unit(1000.0, "x and y look like mm: divide them by 1000", of_positions=True),
        _Unit(100.0, "x and y look like cm: divide them by 100", of_positions=True),
        _Unit(1e-3, "t looks like ms: divide it by 1000"),
        _Unit(1e-6, "t looks like µs: divide it by 1e6"),
        _Unit(1e-9, "t looks like ns: divide it by 1e9"),
    ]


def _tolerance(unit: _Unit, turn: float | None) -> float:
    """Largest relative deviation of the gain of distances from a unit's factor.

    If turns show that omega is right, only x and y can be wrong.
    """
    return _ROUGHLY if unit.of_positions and turn is not None else _EXACTLY


def _turns_agree(unit: _Unit, speed: float, turn: float | None) -> bool:
    """True if the gain of turns is that of a robot whose log has a wrong unit, or unknown."""
    if turn is None:
        return True
    low, high = _TURN_RATIOS
    expected = speed / unit.factor if unit.of_positions else speed
    return low <= turn / expected <= high


def counts_check(drives: Sequence[Drive], speed: float | None) -> Check:
    """Check that sprocket speeds aren't counts since the last reading.

    Counts are whole numbers at any gain. Whole numbers that keep changing from row to row are
    counts, or speeds that were rounded too coarsely. Whole numbers that hardly ever change may also
    be commands, in rad/s if the gain is about 1.
    """
    subject = "counts"
    if not all(drive.has_whole_speeds for drive in drives):
        return Check(subject, Verdict.HOLDS)
    what = "omega_l and omega_r are whole numbers"
    remedy = "of counts, omega is 2 pi counts / (counts per turn * their time)"
    if np.mean([_changing(drive) for drive in drives]) > _HELD_ROWS:
        line = f"{what} that change from row to row, as counts do: {remedy}"
        return Check(subject, Verdict.FAILS, line, alarm="units")
    if speed is None:
        return Check(subject, Verdict.UNKNOWN, f"{what}, and the gain of distances isn't known")
    if 0.8 <= abs(speed) <= 1.2:
        return Check(subject, Verdict.HOLDS)
    line = f"{what}, and the poses move {speed:.3g} times as far: {remedy}"
    return Check(subject, Verdict.FAILS, line, alarm="units")


def signs_check(drives: Sequence[Drive], now: Matching) -> Check:
    """Check that sprocket speeds have signs, if the poses show that the robot drove backwards, or
    turned in place.

    Without signs, a robot that drives backwards seems to drive forwards, and one that turns in
    place seems to drive straight ahead. So distances are those of the poses as long as these go
    forwards, and nothing is wrong with the units.
    """
    subject = "signs of the sprockets"
    is_headed = any(drive.has_heading for drive in drives)
    if any((drive.omega < 0).any() for drive in drives) or not is_headed:
        return Check(subject, Verdict.HOLDS)
    windows = now.windows
    moving = np.isfinite(windows.moved) & np.isfinite(windows.turned)
    moving &= windows.distance > _MOVING
    if moving.sum() < FEW:
        return Check(subject, Verdict.HOLDS)

    # in windows in which the robot drives as far as the belts, or hardly at all
    ahead = windows.moved.real[moving] / windows.distance[moving]
    turned = np.abs(windows.turned[moving])
    backwards = ahead < -_AS_FAR
    straight_by_wheels = np.abs(windows.turn[moving]) < 0.5 * turned
    on_the_spot = (np.abs(ahead) < 1 - _AS_FAR) & (turned > _TURNED_IN_PLACE) & straight_by_wheels
    forwards = ahead > _AS_FAR
    wrong = int(backwards.sum() + on_the_spot.sum())
    share = wrong / len(ahead)
    # few: wild headings; most: an encoder that counts backwards, or a sensor that looks backwards
    if share < _LEAST_WITHOUT_SIGN or forwards.sum() < backwards.sum():
        return Check(subject, Verdict.HOLDS)
    line = (
        "omega_l and omega_r are never negative, but by the poses the robot drives backwards or "
        f"turns in place in {100 * share:.0f} % of its motion: do the encoders count without sign? "
        "Give the speeds the signs of the commands"
    )
    return Check(subject, Verdict.FAILS, line, alarm="signs")


def _changing(drive: Drive) -> float:
    """Share of the encoder intervals whose speeds differ from those before."""
    return float((np.diff(drive.omega, axis=0) != 0).any(axis=1).mean())
