"""How well stored laws predict driving that they were not fitted to: what a law gains, and what another would cost."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from trackslip.slip.nested import entry, number
from trackslip.slip.stored_laws import NO_SLIP, StoredLaws

_USUAL = 5.0  # horizon at which laws are compared, if it was evaluated [s]


@dataclass(frozen=True)
class Error:
    """An error of held-out prediction, rms."""

    what: str
    """What was predicted: heading or position some seconds ahead, or yaw rate or speed at left-out radii."""
    horizon: float | None
    """How far ahead [s]; None for steady driving."""
    size: float
    """The error, in SI units."""
    factor: float
    """From the SI unit to the one that is printed."""
    unit: str
    """The unit that is printed."""

    def __str__(self) -> str:
        return f"{_rounded(self.size * self.factor)} {self.unit}"


_AHEAD = (("heading", "heading_rms", math.degrees(1.0), "deg"), ("position", "position_rms", 1e3, "mm"))
_LEFT_OUT = (("yaw rate", "cv_yaw_rate", 1e3, "mrad/s"), ("speed", "cv_linear_speed", 1e3, "mm/s"))


def errors_of(stored: StoredLaws, law: str) -> list[Error]:
    """Errors of a law by horizon, or at left-out radii where the laws come from steady driving; empty if not known."""
    found = []
    if stored.content.get("method") == "drive":
        horizons = entry(stored.content, "prediction", law)
        for key in horizons if isinstance(horizons, dict) else ():
            for what, name, factor, unit in _AHEAD:
                size = number(horizons, key, name)
                if size is not None and _is_number(key):
                    found.append(Error(what, float(key), size, factor, unit))
        return sorted(found, key=lambda error: (error.horizon or 0.0, error.what))
    for what, key, factor, unit in _LEFT_OUT:
        size = number(stored.content, "laws", law, key)
        if size is not None:
            found.append(Error(what, None, size, factor, unit))
    return found


def gain_lines(stored: StoredLaws, law: str) -> list[str]:
    """By how much dead reckoning gets better with a law: a line per horizon, and one that sums up."""
    pairs = _pairs(errors_of(stored, NO_SLIP), errors_of(stored, law))
    if law == NO_SLIP:
        return []
    if not pairs:
        return ["How much odometry gets better is not known: no held-out prediction was stored with the law."]
    lines = [
        "Prediction of driving that the law was not fitted to, rms error without -> with slip compensation",
        "(both with the noise of the measured motion in it):",
    ]
    for horizon in dict.fromkeys(before.horizon for before, _ in pairs):
        parts = [f"{one.what} {one} -> {two}" for one, two in pairs if one.horizon == horizon]
        where = "at left-out radii" if horizon is None else f"{horizon:g} s ahead"
        lines.append(f"  {where}: {', '.join(parts)}")
    last = pairs[-1][0].horizon
    ratios = [(one.what, one.size, two.size) for one, two in pairs if one.horizon == last and one.size and two.size]
    where = "" if last is None else f", {last:g} s ahead"
    gains = ", ".join(f"{what} {_times(before / after)}" for what, before, after in ratios)
    return [*lines, f"Odometry{where}: {gains}"] if ratios else lines


def best_of(stored: StoredLaws, names: Sequence[str]) -> str:
    """The law out of `names` that predicts best where that is known, else the last of them."""
    errors = {name: _figures(stored, name) for name in names}
    shared = set.intersection(*(set(figures) for figures in errors.values()))
    if not shared:
        return names[-1]
    least = {key: min(figures[key] for figures in errors.values()) for key in shared}
    return min(names, key=lambda name: sum(errors[name][key] / max(least[key], 1e-12) for key in sorted(shared)))


def measured_cost(stored: StoredLaws, law: str, nearest: str) -> str:
    """What predicting by another law costs, as a clause; empty where it was not measured."""
    pairs = _pairs(errors_of(stored, nearest), errors_of(stored, law))
    if pairs:
        horizons = [one.horizon for one, _ in pairs]
        at = _USUAL if _USUAL in horizons else horizons[-1]
        shown = [(one, two) for one, two in pairs if one.horizon == at]
        where = "at left-out radii" if at is None else f"{at:g} s ahead"
        of = " and ".join(f"{one.what}s {where} to {one}" for one, _ in shown)
        other = " and ".join(f"{two}" for _, two in shown)
        return f"it predicts {of} rms, {law} to {other}"
    rms = [number(stored.content, "slip_laws", name, "rms") for name in (nearest, law)]
    if rms[0] is not None and rms[1] is not None:
        return f"it misses track speeds by {rms[0]:.2%} rms, {law} by {rms[1]:.2%}"
    return ""


def _figures(stored: StoredLaws, law: str) -> dict[tuple[str, float | None], float]:
    figures = {(error.what, error.horizon): error.size for error in errors_of(stored, law)}
    rms = number(stored.content, "slip_laws", law, "rms")
    return figures if figures or rms is None else {("rms", None): rms}


def _pairs(some: Sequence[Error], others: Sequence[Error]) -> list[tuple[Error, Error]]:
    """Errors of the same quantities."""
    by = {(error.what, error.horizon): error for error in others}
    return [(error, by[error.what, error.horizon]) for error in some if (error.what, error.horizon) in by]


def _is_number(key: str) -> bool:
    try:
        return math.isfinite(float(key))
    except ValueError:
        return False


def _times(ratio: float) -> str:
    return f"{_rounded(ratio)} times better" if ratio >= 1 else f"{_rounded(1 / ratio)} times worse"


def _rounded(value: float) -> str:
    """A number with three significant digits."""
    return f"{float(f'{value:.3g}'):g}"
