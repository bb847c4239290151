"""Whether a law depends on the length of the windows in which it was fitted.

A pose source that lags in turns, smooths them or drifts measures short motions otherwise than long
ones. The scatter of fits without each block doesn't show that, as all blocks are wrong alike. But
then the law differs between windows of length T and windows of up to 4 T, a quarter of a drive at
most.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from trackslip.identification.comparison import LEAST_ERROR
from trackslip.identification.law_fit import DriveFit
from trackslip.identification.windows import WindowFit, fit_windows
from trackslip.intervals import Gain, cr3
from trackslip.kinematics import Array
from trackslip.laws.families import FAMILIES

_LONGER: Final = 4.0  # ratio of the lengths of windows
_LEAST_LONGER: Final = 2.0  # ratio below which fits hardly differ
_SHARE_OF_DRIVE: Final = 0.25  # largest share of a drive that a window covers
# least difference for an alarm, relative to the radius or half gauge: 10 cm after 10 m. Smaller
# ones only widen the intervals
_MATTERS: Final = 0.01


@dataclass(frozen=True)
class LongerWindows:
    """Parameters of a law that differ if they are fitted in longer windows."""

    shorter: float  # usual length of the windows [s]
    longer: float  # length of the longer windows [s]
    # value and 95 % interval in the longer windows of each parameter that differs by more than the
    # 95 % interval of the difference
    differing: Mapping[str, Gain]
    # names of those whose value in the longer windows is outside the usual interval, by so much
    # that it matters
    outside: tuple[str, ...]

    def line(self, fit: DriveFit) -> str:
        """A line on the differences from a fit in the usual windows, and their possible causes."""
        values = list[str]()
        for name in self.outside:
            unit = FAMILIES[fit.name].parameters[name].unit
            shorter = f"{fit.values[name]:.4g} {unit}".rstrip()
            longer = f"{self.differing[name].value:.4g} {unit}".rstrip()
            values.append(
                f"{name} is {shorter} in windows of {self.shorter:.2g} s, but {longer} in windows "
                f"of {self.longer:.2g} s"
            )
        return (
            f"{', '.join(values)}: poses lag in turns, are smoothed, or drift; the intervals cover "
            "both"
        )


def covering_longer_windows(fit: DriveFit, mean: Array) -> tuple[DriveFit, LongerWindows | None]:
    """The fit with intervals that also cover those in longer windows, where the values differ by
    more than chance; None if nothing differs, or the drives are too short to tell.

    `mean` (p,) are the means of the priors.
    """
    in_longer = _fitted_in_longer_windows(fit.fit, mean)
    if in_longer is None:
        return fit, None
    differing = _differing(fit, in_longer)
    if not differing:
        return fit, None

    # intervals that cover both
    interval95 = dict(fit.interval95)
    outside = list[str]()
    for name, other in differing.items():
        low, high = fit.interval95[name]
        interval95[name] = min(low, other.low), max(high, other.high)
        is_outside = not low <= other.value <= high
        difference = abs(other.value - fit.values[name])
        if is_outside and difference > _MATTERS * _size_of(fit.fit, name):
            outside.append(name)

    found = LongerWindows(
        shorter=fit.fit.length,
        longer=in_longer.length,
        differing=differing,
        outside=tuple(outside),
    )
    return replace(fit, interval95=interval95), found


def _fitted_in_longer_windows(fit: WindowFit, mean: Array) -> WindowFit | None:
    """The same parameters in longer windows, with the same blocks; None if the drives are too
    short, or their poses too far apart.
    """
    if fit.model.far:
        return None
    # the longest windows of which a drive has four; where poses are rare, windows last longer than
    # their nominal length
    nominal_durations = [
        float(drive.time[-1] - drive.time[0]) / drive.span(1.0) for drive in fit.drives.drives
    ]
    longest = _SHARE_OF_DRIVE * max(nominal_durations)
    length = min(_LONGER * fit.length, longest)
    if length < _LEAST_LONGER * fit.length:
        return None
    held = [name for k, name in enumerate(fit.model.names) if k not in fit.free]
    return fit_windows(
        fit.model, fit.drives, length, fit.values, held, mean, block_length=2 * fit.length
    )


def _differing(fit: DriveFit, in_longer: WindowFit) -> dict[str, Gain]:
    """Values with 95 % intervals, in longer windows, of parameters that differ by more than chance.

    Both fits depend on the same blocks, so the variance of the difference is that of the
    differences between fits without each block (CR3). A longer window spans several blocks, whose
    scores are then correlated: the variance in longer windows is as many times larger.
    """
    shorter = fit.fit
    # blocks that a longer window spans: in `shorter`, they last two windows
    overlap = max(1.0, in_longer.length / (2 * shorter.length))
    difference_error = np.sqrt(
        np.diag(cr3(shorter.changes_without_block - in_longer.changes_without_block))
    )
    longer_error = np.sqrt(overlap * np.diag(cr3(in_longer.changes_without_block)))
    quantile = in_longer.quantile

    found = dict[str, Gain]()
    for k, index in enumerate(shorter.free.tolist()):
        name = shorter.model.names[index]
        if name not in fit.values or name not in fit.interval95:
            continue
        value = float(in_longer.values[index])
        difference = abs(value - fit.values[name])
        noticed = LEAST_ERROR * _size_of(shorter, name)
        by_chance = float(quantile[k] * difference_error[k])
        # without enough blocks, chance is NaN
        if difference > noticed and difference > by_chance:
            half_width = float(quantile[k] * longer_error[k])
            found[name] = Gain(value, value - half_width, value + half_width)
    return found


def _size_of(fit: WindowFit, name: str) -> float:
    """What a law's parameter is compared with: the half gauge [m] for lengths, else 1."""
    is_length = fit.model.family.parameters[name].unit == "m"
    return fit.model.geometry.half_gauge if is_length else 1.0
