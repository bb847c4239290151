"""Runs that differ: each has a slip of its own, as on other grounds, or a sensor mounted anew.

A robust fit to all runs together takes those of one ground for outliers. Its values are then those
of the other ground, and leaving out a run may turn it over. So where parameters differ between runs
beyond chance, each run is fitted alone. The law's values are the means over runs, and their
intervals follow from the scatter between runs.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import replace
from typing import Final

import numpy as np
from scipy.special import fdtri

from trackslip.drives.drive import Drives
from trackslip.identification.path import EXTRAS, DriveModel
from trackslip.identification.windows import BEYOND_CHANCE, RunValues, WindowFit, fit_windows
from trackslip.intervals import mean_of_groups
from trackslip.kinematics import Array

_SENSOR: Final = ("sensor_x", "sensor_y", "sensor_yaw")


def fit_runs(
    model: DriveModel,
    drives: Drives,
    length: float,
    values: Array,
    held: Collection[str],
    mean: Array,
) -> WindowFit:
    """Fit as `fit_windows` does; if runs differ beyond chance, with `WindowFit.runs`, and with the
    means over runs as the law's values if the runs are enough for intervals.
    """
    # all runs together
    joint = fit_windows(model, drives, length, values, held, mean)
    names = np.array(model.names)[joint.free]
    differing = set(names[joint.differs_between_runs].tolist())
    is_law_differing = not differing.isdisjoint(model.family.names)
    is_sensor_differing = not differing.isdisjoint(_SENSOR)

    # each run alone: with a sensor of its own if that moves, else with the sensor of all runs
    runs: RunValues | None = None
    if is_sensor_differing:
        runs = _with_sensors(joint, _alone(joint, mean, [*model.family.names, *_SENSOR]))
    # (a sensor that moves by no more than matters leaves the law to be judged)
    if runs is None and is_law_differing:
        fits = _alone(joint, mean, model.family.names)
        differ = [name in differing for name in names if name in model.family.names]
        runs = _values_of(joint, fits, np.array(differ))
    if runs is None:
        return joint

    # the means
    fit = replace(joint, runs=runs)
    if not fit.is_mean_of_runs:
        return fit
    of_law, _ = mean_of_groups(runs.values, runs.variance)
    means = joint.values.copy()
    means[joint.free[: len(of_law)]] = of_law
    return replace(fit, values=means)


def _run_names(drives: Drives) -> list[str]:
    """The names of the runs; a run may consist of several drives."""
    return list(dict.fromkeys(drive.name for drive in drives.drives))


def _alone(joint: WindowFit, mean: Array, free: Collection[str]) -> list[WindowFit]:
    """Fits to each run alone, of the parameters `free` as far as they were fitted to all runs; the
    others have the values of the joint fit.
    """
    model = joint.model
    fitted = [model.names[k] for k in joint.free]
    held = [name for name in model.names if name not in free or name not in fitted]
    fits = list[WindowFit]()
    for name in _run_names(joint.drives):
        own = Drives.of([drive for drive in joint.drives.drives if drive.name == name])
        fits.append(fit_windows(model, own, joint.length, joint.values, held, mean))
    return fits


def _values_of(joint: WindowFit, fits: Sequence[WindowFit], differ: np.ndarray) -> RunValues:
    """The values of the law from fits to single runs."""
    size = len(differ)  # parameters of the law come first
    return RunValues(
        names=tuple(_run_names(joint.drives)),
        values=np.array([fit.values[fit.free[:size]] for fit in fits]),
        variance=np.array([np.diag(fit.inverse)[:size] for fit in fits]),
        differ=differ,
        sensors={},
    )


def _with_sensors(joint: WindowFit, fits: Sequence[WindowFit]) -> RunValues | None:
    """The values of the law from fits to single runs with sensors of their own; None if the sensor
    moves by no more than matters.
    """
    model = joint.model
    sensors = dict[str, Array]()
    for name in _SENSOR:
        values = np.array([fit.values[model.index(name)] for fit in fits])
        if np.ptp(values) > EXTRAS[name].scale:
            sensors[name] = values
    if not sensors:
        return None
    size = int(np.sum(joint.free < len(model.family.names)))
    return replace(_values_of(joint, fits, _differ(fits, size)), sensors=sensors)


def _differ(fits: Sequence[WindowFit], size: int) -> np.ndarray:
    """(size,) bool: true for the first parameters of fits to single runs that differ beyond chance,
    by an F-test.

    A run's value is a mean over its k blocks. Without a block, it changes by -d / k, where d is by
    how much the block's own value differs from the mean. So k c, with the change c, scatters as
    blocks do, and a run's value as a mean of k blocks.
    """
    values = np.array([fit.values[fit.free[:size]] for fit in fits])
    blocks = np.array([len(fit.score) for fit in fits])
    run_freedom = len(fits) - 1
    block_freedom = int(blocks.sum()) - len(fits)
    if block_freedom < 1:
        return np.zeros(size, bool)
    apart = values - np.average(values, axis=0, weights=blocks)
    between = np.sum(blocks[:, None] * apart**2, axis=0) / run_freedom
    of_blocks = [len(fit.score) * fit.changes_without_block[:, :size] for fit in fits]
    within = np.sum(np.concatenate(of_blocks) ** 2, axis=0) / block_freedom
    by_chance = fdtri(run_freedom, block_freedom, BEYOND_CHANCE)
    return np.asarray(between > by_chance * within)
