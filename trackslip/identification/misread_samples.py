"""Whether the columns of steady samples hold what their names say: units, sides and signs.

A unit that is wrong is wrong in every row. So the rows are judged together, before any of them is
left out for itself: if another reading of the columns fits nearly all of them, and far more than
the reading as logged, the samples are refused with the name of the column and the remedy.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import Final

import numpy as np

from trackslip.errors import LogError
from trackslip.identification.samples import are_plausible, contradiction_of
from trackslip.kinematics import Array, RobotGeometry, body_twist
from trackslip.logs.layout import UNITS

# least share of the rows that another reading fits: single rows may be wrong, too
_LEAST_FITTING: Final = 0.8
# least share of the rows by which another reading fits more than the one as logged
_LEAST_GAIN: Final = 0.25
# share of implausible rows above which the samples are refused in any case: the rest is no majority
_MOST_IMPLAUSIBLE: Final = 0.5
# limits on the median ratio of yaw rates to the sprockets': a separation multiplier of 0.8 to 5, as
# in drives.misread
_TURN_RATIOS: Final = (0.2, 1.25)
# least speed of a motion, ahead or of the tracks in a turn, relative to the speed of the belts [-]
_LEAST_MOTION: Final = 0.1
# largest difference of the logarithms of speeds by which two units may be mixed up
_MOST_ALIKE: Final = 0.1
# wrong units of the columns that occur in logs
_UNITS_OF_V: Final = ("cm/s", "mm/s", "km/h")
_UNITS_OF_OMEGA: Final = ("rpm", "deg/s", "turn/s")
_UNITS_OF_BELTS: Final = ("m/s", "cm/s", "mm/s")


@dataclass(frozen=True)
class _Mistake:
    """One column, or a pair of columns, read otherwise than as logged."""

    subject: str  # what is read otherwise; a reading has one mistake of each subject at most
    omega: Array  # (2, 2) matrix from the logged sprocket speeds to those that are meant
    twist: Array  # (2,) factors from the logged twist to the one that is meant
    line: str  # the mistake, and the remedy


@dataclass(frozen=True)
class _Reading:
    """One or two mistakes, without which the columns fit."""

    lines: tuple[str, ...]  # each mistake, and the remedy
    fitting: int  # number of rows that fit without them
    # by how much the median speed differs from the sprockets', as a logarithm
    speed_difference: float

    @property
    def line(self) -> str:
        """All mistakes in one line."""
        return "; and ".join(self.lines)


def refuse_misread(
    omega: Array, twist: Array, geometry: RobotGeometry, rows: Sequence[int]
) -> None:
    """Raise LogError if the columns of samples, sprocket speeds (n, 2) and twists (n, 2), are in
    wrong units, or if sides or signs are wrong; `rows` (n,) are the samples' rows in the table.
    """
    # other readings, if enough rows don't fit as logged
    count = len(omega)
    as_logged = int(_fitting(omega, twist, geometry).sum())
    least_gain = max(1.0, _LEAST_GAIN * count)
    if count - as_logged >= least_gain:
        least = max(as_logged + least_gain, _LEAST_FITTING * count)
        readings = _best_readings(omega, twist, geometry, least)
        if readings:
            mistakes = "; or ".join(reading.line for reading in readings)
            fitting = readings[0].fitting
            raise LogError(
                f"{mistakes} ({fitting} of {count} rows fit then, but {as_logged} as logged)"
            )

    # no other reading explains rows that no robot moves by
    implausible = np.flatnonzero(~are_plausible(omega, twist, geometry)).tolist()
    if len(implausible) > _MOST_IMPLAUSIBLE * count:
        first = implausible[0]
        contradiction = contradiction_of(omega[first], twist[first], geometry)
        raise LogError(
            f"{len(implausible)} of {count} rows contradict their sprockets; row "
            f"{rows[first] + 1}: {contradiction}"
        )


def _best_readings(
    omega: Array, twist: Array, geometry: RobotGeometry, least: float
) -> list[_Reading]:
    """The readings with fewest mistakes that fit most rows, and at least `least`; of these, those
    by which speeds are nearest to the sprockets'. Empty if there are none.

    Several are alike if two units are: with sprockets of 0.1 m, rpm and belts in cm/s.
    """
    mistakes = list(_mistakes(geometry))
    for number in (1, 2):
        readings = list[_Reading]()
        for some in combinations(mistakes, number):
            if len({mistake.subject for mistake in some}) < number:
                continue
            read_omega, read_twist = _corrected(omega, twist, some)
            fitting = int(_fitting(read_omega, read_twist, geometry).sum())
            if fitting >= least:
                lines = tuple(mistake.line for mistake in some)
                difference = _speed_difference(read_omega, read_twist, geometry)
                readings.append(_Reading(lines, fitting, difference))
        if readings:
            most = max(reading.fitting for reading in readings)
            best = [reading for reading in readings if reading.fitting == most]
            nearest = min(reading.speed_difference for reading in best)
            return [
                reading for reading in best if reading.speed_difference <= nearest + _MOST_ALIKE
            ]
    return []


def _corrected(omega: Array, twist: Array, reading: Sequence[_Mistake]) -> tuple[Array, Array]:
    """The sprocket speeds (n, 2) and twists (n, 2) that are meant."""
    for mistake in reading:
        omega = omega @ mistake.omega.T
        twist = twist * mistake.twist
    return omega, twist


def _fitting(omega: Array, twist: Array, geometry: RobotGeometry) -> np.ndarray:
    """(n,) bool: true for samples that are plausible, by themselves and together.

    If the samples that turn usually have a smaller or larger share of the sprockets' yaw rate than
    any robot, none of these is.
    """
    fitting = are_plausible(omega, twist, geometry)
    turning, ratio = _turn_ratio(omega, twist, geometry)
    low, high = _TURN_RATIOS
    if ratio is not None and not low <= ratio <= high:
        fitting &= ~turning
    return fitting


def _turn_ratio(
    omega: Array, twist: Array, geometry: RobotGeometry
) -> tuple[np.ndarray, float | None]:
    """(n,) bool, true for samples whose sprockets turn the robot, and the median ratio of their
    yaw rates to the sprockets'; None if no sample turns.
    """
    commanded = body_twist(omega, 0.0, geometry)[:, 1]
    belts = geometry.sprocket_radius * np.abs(omega).max(axis=1)
    turning = np.abs(commanded) * geometry.half_gauge > _LEAST_MOTION * belts
    if not turning.any():
        return turning, None
    return turning, float(np.median(twist[turning, 1] / commanded[turning]))


def _speed_difference(omega: Array, twist: Array, geometry: RobotGeometry) -> float:
    """By how much the median speed differs from the sprockets', as a logarithm; 0 if none moves
    ahead.
    """
    commanded = body_twist(omega, 0.0, geometry)[:, 0]
    belts = geometry.sprocket_radius * np.abs(omega).max(axis=1)
    moving = np.abs(commanded) > _LEAST_MOTION * belts
    if not moving.any():
        return 0.0
    ratio = float(np.median(np.abs(twist[moving, 0] / commanded[moving])))
    return abs(math.log(max(ratio, 1e-9)))


def _mistakes(geometry: RobotGeometry) -> Iterator[_Mistake]:
    """Mistakes that occur in tables of steady samples."""
    same = np.eye(2)
    unscaled = np.ones(2)

    # units; only the options of units that a table may state are named
    both = "omega_l and omega_r look like"
    for unit in _UNITS_OF_OMEGA:
        option = f"--columns omega_l=omega_l:{unit},omega_r=omega_r:{unit}"
        line = f"{both} {unit}, not rad/s: {option} reads them"
        yield _Mistake("omega", UNITS["rad/s"][unit] * same, unscaled, line)
    for unit in _UNITS_OF_BELTS:
        option = f"--columns omega_l=omega_l:{unit},omega_r=omega_r:{unit}"
        line = f"{both} speeds of the belts in {unit}: {option} reads them"
        factor = UNITS["m/s"][unit]
        yield _Mistake("omega", factor / geometry.sprocket_radius * same, unscaled, line)
    for unit in _UNITS_OF_V:
        line = f"v looks like {unit}, not m/s: --columns v=v:{unit} reads it"
        yield _Mistake("v", same, np.array([UNITS["m/s"][unit], 1.0]), line)
    line = "w looks like deg/s, not rad/s: --columns w=w:deg/s reads it"
    yield _Mistake("w", same, np.array([1.0, UNITS["rad/s"]["deg/s"]]), line)

    # sides and signs
    exchanged = same[::-1]
    line = (
        "tracks are swapped: exchange omega_l and omega_r, or change the sign of w if it is "
        "positive to the right"
    )
    yield _Mistake("sides", exchanged, unscaled, line)
    line = "the motion is backwards by the sprockets: change the signs of omega_l and omega_r"
    yield _Mistake("sides", -same, unscaled, line)
    line = "v is backwards by the sprockets: change its sign"
    yield _Mistake("sides", same, np.array([-1.0, 1.0]), line)
    for side, column in enumerate(("omega_l", "omega_r")):
        signs = np.ones(2)
        signs[side] = -1.0
        line = f"{column} counts backwards: change its sign"
        yield _Mistake("sides", np.diag(signs), unscaled, line)
