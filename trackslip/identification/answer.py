"""The answer of an identification: the law of a differential drive that gives the multipliers, and
what the driving doesn't determine.

The law is `diff_drive`: a radius of each side, and the distance between the ICRs. If the radii
don't differ significantly, it is `icr_radius`, which has one radius for both sides.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

import numpy as np

from trackslip.identification.comparison import FittedLaw, differs_from_zero
from trackslip.intervals import Gain
from trackslip.laws.families import DIFF_DRIVE

NO_POSITIONS: Final = "no positions were measured"
"""The reason for a radius that is held in `FittedLaw.held`, if the log holds headings alone."""
TOO_LITTLE: Final = "too little driving for an interval"
"""What stands in place of an interval whose ends are NaN."""
SIDES: Final = ("left", "right")
_DRIVE_TURNS: Final = "not determined: drive turns to both sides"
# the interval of the separation allows for it, by comparison.MACHINED
_DRIVE_STRAIGHT: Final = (
    "not determined: drive straight from one pose to another (taken as 1 ± 0.04)"
)
_MEASURE_POSITIONS: Final = "not determined: measure positions, too (taken as 1)"


def radii_differ(fit: FittedLaw) -> bool:
    """True if the radii of left and right differ, by the 95 % interval of the difference."""
    difference = combined(fit, {"radius_error_right": 1.0, "radius_error_left": -1.0})
    return difference.low > 0 or difference.high < 0


def answer_of(fit: FittedLaw, half_gauge: float) -> dict[str, Gain]:
    """The multipliers of a differential drive, D [m] and the mean ε by a law, with 95 % intervals.

    Values that the driving doesn't determine are NaN, as `undetermined` explains. Both ends of an
    interval are NaN if there is too little driving.
    """
    offset = combined(fit, _mean(fit, "offset"))
    left_error = combined(fit, _mean(fit, "radius_error", "left"))
    right_error = combined(fit, _mean(fit, "radius_error", "right"))
    answer = {
        "wheel_separation_multiplier": _multiplier(offset, half_gauge),
        "left_wheel_radius_multiplier": _multiplier(left_error),
        "right_wheel_radius_multiplier": _multiplier(right_error),
        "offset": offset,
        "radius_error": combined(fit, _mean(fit, "radius_error")),
    }
    for name in undetermined(fit):
        answer[name] = Gain(np.nan, np.nan, np.nan)
    return answer


def _multiplier(excess: Gain, unit: float = 1.0) -> Gain:
    """The ratio to the nominal value, given the excess over it in some unit."""
    value, low, high = excess
    return Gain(1 + value / unit, 1 + low / unit, 1 + high / unit)


def undetermined(fit: FittedLaw) -> dict[str, str]:
    """The values of the answer that the driving doesn't determine, by key, with the manoeuvre that
    would determine each.

    Start and end poses of closed squares tell the difference between the radii, but not their mean.
    The radii of each side are then those of wheels whose mean is nearly the nominal radius, and
    only `radius_error` is undetermined.
    """
    found = dict[str, str]()
    if _is_open(fit, "offset"):
        found["wheel_separation_multiplier"] = _DRIVE_TURNS
        found["offset"] = _DRIVE_TURNS

    radii = _mean(fit, "radius_error")
    if not radii or not all(_is_open(fit, name) for name in radii):
        return found
    unmeasured = all(fit.held[name] == NO_POSITIONS for name in radii)
    remedy = _MEASURE_POSITIONS if unmeasured else _DRIVE_STRAIGHT
    found["radius_error"] = remedy
    is_difference_known = fit.name == DIFF_DRIVE and radii_differ(fit)
    if not is_difference_known:
        for side in SIDES:
            found[f"{side}_wheel_radius_multiplier"] = remedy
    return found


def _is_open(fit: FittedLaw, name: str) -> bool:
    """True if the driving doesn't determine a parameter; one that differs from 0 is determined,
    however wide its interval is.
    """
    return name in fit.held and not differs_from_zero(fit, name)


def combined(fit: FittedLaw, weights: Mapping[str, float]) -> Gain:
    """A weighted sum of a law's parameters, with a 95 % interval whose ends are NaN if none of them
    was fitted.

    An end lies as far from the sum as the parameters' ends on that side from their values, which a
    limit of the law may cut off.
    """
    value = sum((weight * fit.values[name] for name, weight in weights.items()), 0.0)
    fitted = [name for name in weights if name in fit.stderr]
    if not fitted:
        return Gain(value, np.nan, np.nan)

    # errors add like vectors whose angles have the correlations as cosines
    of_stderr = list(fit.stderr)
    rows = [of_stderr.index(name) for name in fitted]
    correlation = fit.correlation[np.ix_(rows, rows)]
    below = list[float]()
    above = list[float]()
    for name in fitted:
        low, high = fit.interval95[name]
        ends = weights[name] * (np.array([low, high]) - fit.values[name])
        below.append(float(ends.min()))
        above.append(float(ends.max()))
    signs = np.sign([weights[name] for name in fitted])

    def distance(ends: list[float]) -> float:
        vector = signs * np.abs(ends)
        return float(np.sqrt(vector @ correlation @ vector))

    return Gain(value, value - distance(below), value + distance(above))


def _mean(fit: FittedLaw, key: str, side: str = "") -> dict[str, float]:
    """Weights of the parameters whose mean is D or ε, of a side or of both; empty if the law has
    none.
    """
    names = [name for name in fit.values if name == key or name.startswith(f"{key}_{side}")]
    return {name: 1 / len(names) for name in names}
