"""Runs in groups of about the same value, as a grid of commands leaves them."""

from __future__ import annotations

import numpy as np

from trackslip.kinematics import Array

_MAX_GROUPS = 8
_PARTS = 5  # of scattered values
_MIN_SCATTERED = 3  # scattered values that make a part
_GAP = 0.08  # relative gap between neighbouring values that starts another group


def alike(values: Array) -> list[np.ndarray]:
    """Indices of `values` (n,) >= 0 in groups of about the same value, ascending.

    A grid of commanded values leaves clear gaps between its groups, so no log has to say what was commanded.
    Values that are scattered, or of many groups, come in a few parts of about equal numbers.
    """
    order = np.argsort(values, kind="stable")
    if not order.size:
        return []
    ranked = values[order]
    starts = np.flatnonzero(np.diff(ranked) > _GAP * ranked[1:]) + 1
    groups = np.split(order, starts)
    if len(groups) <= _MAX_GROUPS and all(narrow(values[group]) for group in groups):
        return groups
    return np.array_split(order, max(1, min(_PARTS, order.size // _MIN_SCATTERED)))


def narrow(values: Array) -> bool:
    """Whether values (n,) >= 0 are about the same."""
    return bool(np.ptp(values) <= 2 * _GAP * values.max())


def repeated(values: Array) -> list[np.ndarray]:
    """The groups of `alike` whose values are about the same, of two runs or more, if there are several groups."""
    groups = alike(values)
    return [group for group in groups if len(group) > 1 and narrow(values[group])] if len(groups) > 1 else []


def span(values: Array, unit: str) -> str:
    """The mean of values that are about the same, else their range, with the unit."""
    if narrow(values):
        return f"{values.mean():.2f} {unit}"
    return f"{values.min():.2f}–{values.max():.2f} {unit}"
