"""Accuracy of stored laws on driving that they were not fitted to, as their files record it."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

from trackslip.slip.law_file import NO_SLIP, StoredLaws, entry, number

Quantity = tuple[str, float | None]
"""Predicted quantity and horizon [s]; None for steady driving at radii that were left out of the fit."""

_USUAL = 5.0  # horizon at which laws are compared, if it was evaluated [s]
_UNITS = {
    "heading": (math.degrees(1.0), "deg"),
    "position": (1e3, "mm"),
    "yaw rate": (1e3, "mrad/s"),
    "speed": (1e3, "mm/s"),
}
_LEFT_OUT = {"yaw rate": "cv_yaw_rate", "speed": "cv_linear_speed"}


def prediction_errors(stored: StoredLaws, law: str) -> dict[Quantity, float]:
    """Rms errors of a law's held-out predictions in SI units, by quantity; empty where none are stored."""
    if stored.content.get("method") != "drive":
        steady = {what: number(stored.content, "laws", law, key) for what, key in _LEFT_OUT.items()}
        return {(what, None): size for what, size in steady.items() if size is not None}
    horizons = entry(stored.content, "prediction", law)
    found: dict[Quantity, float] = {}
    for ahead in sorted(filter(_is_number, horizons), key=float) if isinstance(horizons, Mapping) else ():
        for what in ("heading", "position"):
            size = number(horizons, ahead, f"{what}_rms")
            if size is not None:
                found[what, float(ahead)] = size
    return found


def gain_lines(stored: StoredLaws, law: str) -> list[str]:
    """Improvement of dead reckoning by a law: a line per horizon, and a summary."""
    if law == NO_SLIP:
        return []
    without, compensated = prediction_errors(stored, NO_SLIP), prediction_errors(stored, law)
    shared = [quantity for quantity in without if quantity in compensated]
    if not shared:
        return ["How much odometry gets better is not known: no held-out prediction was stored with the law."]
    lines = [
        "Prediction of driving that the law was not fitted to, rms error without -> with slip compensation",
        "(both with the noise of the measured motion in it):",
    ]
    for horizon in dict.fromkeys(ahead for _, ahead in shared):
        parts = [
            f"{what} {_printed(what, without[what, ahead])} -> {_printed(what, compensated[what, ahead])}"
            for what, ahead in shared
            if ahead == horizon
        ]
        lines.append(f"  {_place(horizon)}: {', '.join(parts)}")
    last = shared[-1][1]
    ratios = {
        what: without[what, ahead] / compensated[what, ahead]
        for what, ahead in shared
        if ahead == last and without[what, ahead] and compensated[what, ahead]
    }
    if ratios:
        gains = ", ".join(f"{what} {_times(ratio)}" for what, ratio in ratios.items())
        lines.append(f"Odometry{'' if last is None else f', {_place(last)}'}: {gains}")
    return lines


def best_predicting(stored: StoredLaws, names: Sequence[str]) -> str:
    """The law out of `names` with the smallest errors, of prediction or else of the fit; the last if none are known."""
    errors: dict[str, dict[Quantity, float]] = {}
    for name in names:
        rms = number(stored.content, "slip_laws", name, "rms")
        errors[name] = prediction_errors(stored, name) or ({} if rms is None else {("slip", None): rms})
    shared = [key for key in errors[names[0]] if all(key in one for one in errors.values())]
    if not shared:
        return names[-1]
    least = {key: max(min(one[key] for one in errors.values()), 1e-12) for key in shared}
    return min(names, key=lambda name: sum(errors[name][key] / least[key] for key in shared))


def cost_of(stored: StoredLaws, law: str, instead: str) -> str:
    """Accuracy lost by using `instead` in place of `law`, as a clause."""
    errors, others = prediction_errors(stored, law), prediction_errors(stored, instead)
    shared = [quantity for quantity in others if quantity in errors]
    if shared:
        horizons = [ahead for _, ahead in shared]
        at = _USUAL if _USUAL in horizons else horizons[-1]
        shown = [(what, ahead) for what, ahead in shared if ahead == at]
        by_it = " and ".join(f"{what}s {_place(at)} to {_printed(what, others[what, at])}" for what, _ in shown)
        by_law = " and ".join(_printed(what, errors[what, at]) for what, _ in shown)
        return f"it predicts {by_it} rms, {law} to {by_law}"
    rms, other = (number(stored.content, "slip_laws", name, "rms") for name in (law, instead))
    if rms is None or other is None:
        return "by how much it is worse is not known: no errors were stored with the laws"
    return f"it misses track speeds by {other:.2%} rms, {law} by {rms:.2%}"


def _is_number(key: str) -> bool:
    try:
        return math.isfinite(float(key))
    except ValueError:
        return False


def _place(horizon: float | None) -> str:
    return "at left-out radii" if horizon is None else f"{horizon:g} s ahead"


def _printed(what: str, size: float) -> str:
    factor, unit = _UNITS[what]
    return f"{_rounded(size * factor)} {unit}"


def _times(ratio: float) -> str:
    return f"{_rounded(ratio)} times better" if ratio >= 1 else f"{_rounded(1 / ratio)} times worse"


def _rounded(value: float) -> str:
    """A number with three significant digits."""
    return f"{float(f'{value:.3g}'):g}"
