"""Runs in groups of nearly equal values, such as a grid of commands produces."""

import numpy as np

from trackslip.kinematics import Array

_MAX_GROUPS = 8
_PARTS = 5  # parts that scattered values are split into
_MIN_SCATTERED = 3  # scattered values per part
_GAP = 0.08  # relative gap between neighbouring values that starts another group


def value_groups(values: Array) -> list[np.ndarray]:
    """Indices of `values` (n,) >= 0 in groups of nearly equal values, ascending.

    A grid of commanded values leaves clear gaps between its groups, so that no log has to state what was commanded.
    Values that are scattered, or that form many groups, are split into a few parts of about equal size.
    """
    order = np.argsort(values, kind="stable")
    if not order.size:
        return []
    ranked = values[order]
    starts = np.flatnonzero(np.diff(ranked) > _GAP * ranked[1:]) + 1
    groups = np.split(order, starts)
    if len(groups) <= _MAX_GROUPS and all(is_narrow(values[group]) for group in groups):
        return groups
    return np.array_split(order, max(1, min(_PARTS, order.size // _MIN_SCATTERED)))


def is_narrow(values: Array) -> bool:
    """Whether values (n,) >= 0 are nearly equal."""
    return bool(np.ptp(values) <= 2 * _GAP * values.max())


def repeated(values: Array) -> list[np.ndarray]:
    """The groups of two or more nearly equal values; none if all values form one group."""
    groups = value_groups(values)
    return [group for group in groups if len(group) > 1 and is_narrow(values[group])] if len(groups) > 1 else []


def group_label(values: Array, unit: str) -> str:
    """The mean of values that are nearly equal, else their range, with the unit."""
    if is_narrow(values):
        return f"{values.mean():.2f} {unit}"
    return f"{values.min():.2f}–{values.max():.2f} {unit}"
