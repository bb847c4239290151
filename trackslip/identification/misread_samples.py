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

# share of the rows that another reading fits at least, and share by which it fits more than the
# reading as logged
_NEARLY_ALL: Final = 0.8
_FAR_MORE: Final = 0.25
_MOST: Final = 0.5  # share of implausible rows above which the samples are refused in any case
# limits on the median ratio of yaw rates to the sprockets': a separation multiplier of 0.8 to 5, as
# in drives.misread
_TURN_RATIOS: Final = (0.2, 1.25)
# yaw rate below which a row tells nothing of turns, relative to the speed of its belts over the
# half gauge [-]
_TURNING: Final = 0.1
_ALIKE: Final = 0.1  # difference of the logarithms of speeds by which two units may be mixed up
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


def refuse_misread(
    omega: Array, twist: Array, geometry: RobotGeometry, rows: Sequence[int]
) -> None:
    """Raise LogError if the columns of samples, sprocket speeds (n, 2) and twists (n, 2), are in
    wrong units, or if sides or signs are wrong; `rows` (n,) are the samples' rows in the table.
    """
    count = len(omega)
    fitting = _fitting(omega, twist, geometry)
    most_gain = count - int(fitting.sum())
    least_gain = max(1.0, _FAR_MORE * count)
    if most_gain >= least_gain:
        found = _best_reading(omega, twist, geometry, int(fitting.sum()) + least_gain)
        if found:
            raise LogError(f"{found}, but {int(fitting.sum())} as logged)")

    plausible = are_plausible(omega, twist, geometry)
    wrong = np.flatnonzero(~plausible).tolist()
    if len(wrong) > _MOST * count:
        first = wrong[0]
        contradiction = contradiction_of(omega[first], twist[first], geometry)
        raise LogError(
            f"{len(wrong)} of {count} rows contradict their sprockets; row {rows[first] + 1}: "
            f"{contradiction}"
        )


def _best_reading(omega: Array, twist: Array, geometry: RobotGeometry, least: float) -> str:
    """The reading with fewest mistakes that fits at least `least` rows and nearly all, as the
    beginning of a message; of several, those by which speeds are nearest to the sprockets'. Empty
    if there is none.
    """
    mistakes = list(_mistakes(geometry))
    for number in (1, 2):
        found = list[tuple[int, float, str]]()
        for reading in combinations(mistakes, number):
            if len({mistake.subject for mistake in reading}) < number:
                continue
            read_omega, read_twist = _corrected(omega, twist, reading)
            rows = int(_fitting(read_omega, read_twist, geometry).sum())
            if rows < max(least, _NEARLY_ALL * len(omega)):
                continue
            line = "; and ".join(mistake.line for mistake in reading)
            found.append((-rows, _distance(read_omega, read_twist, geometry), line))
        if found:
            most_rows, nearest, _ = min(found)
            # two units may be alike: with sprockets of 0.1 m, rpm and belts in cm/s are
            alike = [
                line
                for count, distance, line in found
                if count == most_rows and distance <= nearest + _ALIKE
            ]
            return f"{'; or '.join(alike)} ({-most_rows} of {len(omega)} rows fit then"
    return ""


def _corrected(omega: Array, twist: Array, reading: Sequence[_Mistake]) -> tuple[Array, Array]:
    """The sprocket speeds (n, 2) and twists (n, 2) that are meant."""
    for mistake in reading:
        omega = omega @ mistake.omega.T
        twist = twist * mistake.twist
    return omega, twist


def _fitting(omega: Array, twist: Array, geometry: RobotGeometry) -> np.ndarray:
    """(n,) bool: true for samples that are plausible, also among the others: none that turns is, if
    most lose more of their yaw rates than any robot does.
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
    turning = np.abs(commanded) * geometry.half_gauge > _TURNING * belts
    if not turning.any():
        return turning, None
    return turning, float(np.median(twist[turning, 1] / commanded[turning]))


def _distance(omega: Array, twist: Array, geometry: RobotGeometry) -> float:
    """Distance of the median speed from the sprockets', as a logarithm; 0 if none moves ahead."""
    commanded = body_twist(omega, 0.0, geometry)[:, 0]
    belts = geometry.sprocket_radius * np.abs(omega).max(axis=1)
    moving = np.abs(commanded) > _TURNING * belts
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
    line = "tracks are swapped: exchange omega_l and omega_r, or change the sign of w if it is "
    yield _Mistake("sides", exchanged, unscaled, f"{line}positive to the right")
    line = "the motion is backwards by the sprockets: change the signs of omega_l and omega_r"
    yield _Mistake("sides", -same, unscaled, line)
    line = "v is backwards by the sprockets: change its sign"
    yield _Mistake("sides", same, np.array([-1.0, 1.0]), line)
    for side, column in enumerate(("omega_l", "omega_r")):
        signs = np.ones(2)
        signs[side] = -1.0
        line = f"{column} counts backwards: change its sign"
        yield _Mistake("sides", np.diag(signs), unscaled, line)
