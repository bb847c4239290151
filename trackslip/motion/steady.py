"""Steady stretches of a run, where sprocket speeds are constant, the clock has no gap and poses
move steadily.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Final

import numpy as np

from trackslip.errors import LogError
from trackslip.kinematics import Array
from trackslip.logs.runlog import RunLog
from trackslip.motion.arc import MIN_ARC_POSES, arc
from trackslip.motion.steady_twist import within

SETTLE: Final = 1.5  # default time from steady sprocket speeds to steady motion [s]
_BLOCK: Final = 0.5  # duration of the blocks over which sprocket speeds are averaged [s]
# largest change in a steady sprocket's mean speed, relative to the faster sprocket's speed [-]
_DRIFT: Final = 0.05
# speed, relative to the run's highest, below which the largest change is constant [-]
_SLOW: Final = 0.2
# largest change in mean speeds that encoder noise explains [standard deviations]
_NOISE: Final = 4.0
MARGIN: Final = 0.5
"""Time excluded at the end of a steady stretch, and minimum time excluded at its start, for filter
transients [s].
"""
_SHORTEST: Final = 0.5  # minimum duration of a stretch without the excluded times [s]
_GAP: Final = 5.0  # time step above which the clock has a gap [median time steps]
_MIN_GAP: Final = 0.3  # minimum time step that counts as a gap [s]
# speed up to which a sprocket is at rest, less than a turn in an hour and a half [rad/s]
STANDING: Final = 1e-3
_RESTING: Final = 0.01  # speed up to which a sprocket is at rest, relative to the run's highest [-]
# minimum number of valid poses in each half of a stretch if the halves are compared
_MIN_HALF: Final = 2 * MIN_ARC_POSES
_SIGNIFICANT: Final = 6.0  # smallest significant difference between the halves [standard errors]
_CHANGE: Final = 0.05  # smallest relevant relative change of the twist [-]
# curvature of a nearly straight path [1/m], and radius of a turn nearly on the spot [m]
_TURNING: Final = 0.2
_LISTED: Final = 3  # maximum number of gaps in the message if no stretch is long enough
_LOAD_CHANGE: Final = 0.1  # largest change of the traction per unit load within a piece [-]
_SHORTEST_PIECE: Final = 1.5  # minimum duration of a piece [s]


@dataclass(frozen=True)
class SteadyPart:
    """A stretch of a run with constant sprocket speeds and no gap in the clock."""

    name: str
    """Name of the run and, if the run has several stretches, the start time of this stretch."""
    log: RunLog
    """The run from the end of the previous stretch to the start of the next stretch."""
    window: tuple[float, float]
    """Start and end of the stretch [s]."""
    notes: tuple[str, ...]
    """A line for each excluded part of the run, apart from settling; equal for all stretches of the
    run.
    """

    @cached_property
    def rows(self) -> np.ndarray:
        """Mask (T,) of the rows in the window."""
        return within(self.log.time, self.window)

    @cached_property
    def omega(self) -> Array:
        """Mean sprocket speeds (2,) in the window [rad/s]."""
        rows = self.rows
        return np.asarray(
            np.average(self.log.omega[rows], axis=0, weights=np.diff(self.log.time)[rows[1:]])
        )

    @cached_property
    def load(self) -> Array | None:
        """Mean tractions per unit load (2,) in the window [-]; None if the run has no tractions."""
        if self.log.load is None:
            return None
        known = self.log.load[self.rows]
        known = known[np.isfinite(known).all(axis=1)]
        return np.asarray(known.mean(axis=0)) if len(known) else None


def turning_stretches(log: RunLog) -> int:
    """Number of sufficiently long stretches in which the sprockets turn at constant speeds."""
    pieces, _ = constant_stretches(
        log.time, log.omega, np.zeros(0, int), SETTLE + MARGIN + _SHORTEST
    )
    return sum(_turns(log.omega, *piece) for piece in pieces)


def steady_part(log: RunLog, settle: float = SETTLE) -> SteadyPart:
    """Find the longest steady stretch of a run, named like the run. Raises LogError like
    `steady_parts`.
    """
    longest = max(steady_parts(log, settle), key=lambda part: part.window[1] - part.window[0])
    return replace(longest, name=log.run)


def steady_parts(log: RunLog, settle: float = SETTLE) -> tuple[SteadyPart, ...]:
    """Find all steady stretches of a run in which the sprockets turn, each without its first
    `settle` [s].

    Raises LogError if the run is at rest, has no headings or has no sufficiently long steady
    stretch.
    """
    _require_headings(log)
    step = np.diff(log.time)
    gaps = np.flatnonzero(step > max(_GAP * float(np.median(step)), _MIN_GAP))
    late = [
        f"its clock has a gap from t = {log.time[k]:.12g} s to {log.time[k + 1]:.12g} s"
        for k in gaps
    ]
    notes = [f"run {log.run!r}: {gap}" for gap in late]
    lead = max(settle, MARGIN)
    headed = log.time[log.has_heading]
    usual = float(np.median(np.diff(headed))) if len(headed) > 1 else 0.0  # between poses
    enough = max(_SHORTEST, (MIN_ARC_POSES - 1) * usual)
    least = lead + MARGIN + enough
    long, longest = constant_stretches(log.time, log.omega, gaps, least)
    if not long:
        begin, end = log.time[list(longest)]
        why = [*late[:_LISTED], f"steady from {begin:.12g} s to {end:.12g} s only, too short"]
        left_out = (
            f"the first {lead:g} s and last {MARGIN:g} s of it are left out, and an arc "
            f"needs {enough:.2g} s"
        )
        raise LogError(f"run {log.run!r}: {'; '.join(why)}: {left_out}")
    moving = [piece for piece in long if _turns(log.omega, *piece)]
    if not moving:
        raise LogError(f"run {log.run!r}: the sprockets stand still")
    windows = [
        (float(log.time[first]) + lead, float(log.time[last]) - MARGIN) for first, last in moving
    ]
    first, last = moving[0]
    if len(long) == 1 and log.time[last] - log.time[first] < 0.8 * (log.time[-1] - log.time[0]):
        begin, end = windows[0]
        notes.append(f"run {log.run!r}: steady, and used, from {begin:.12g} s to {end:.12g} s only")
    parts = []
    for k, window in enumerate(windows):
        before = moving[k - 1][1] + 1 if k else 0
        after = moving[k + 1][0] if k + 1 < len(moving) else len(log.time)
        name = log.run if len(moving) == 1 else f"{log.run} @ {window[0]:.1f} s"
        parts.append(SteadyPart(name, log.between(before, after), window, tuple(notes)))
    return tuple(parts)


def require_steady_motion(part: SteadyPart) -> None:
    """Raise LogError if the poses of a steady stretch jump, or the twist differs between its
    halves.

    The twist changes, for example, when the robot drives onto other ground or against an obstacle.
    """
    begin, end = part.window
    arc(part.log, part.window)  # raises LogError for jumps
    middle = (begin + end) / 2
    valid = part.rows & part.log.is_valid
    is_late = part.log.time > middle
    if min((valid & ~is_late).sum(), (valid & is_late).sum()) < _MIN_HALF:
        return  # too few poses to compare
    first = arc(part.log, (begin, middle))
    second = arc(part.log, (middle, end))
    change = second.twist - first.twist

    # beyond chance
    variance = np.diag(first.covariance + second.covariance)
    error = np.sqrt(np.maximum(variance, 0.0))
    is_significant = np.abs(change) > _SIGNIFICANT * error

    # and relative to the motion
    v, w = np.abs(np.stack([first.twist, second.twist])).max(axis=0)
    size = np.array([v + _TURNING * w, w + _TURNING * v])
    is_relevant = np.abs(change) > _CHANGE * size
    if (is_significant & is_relevant).any():
        raise LogError(
            f"run {part.log.run!r}: its sprockets are steady from {begin:.12g} s to {end:.12g} "
            "s, but its motion is "
            f"not: v changes by {change[0]:+.3g} m/s and w by {change[1]:+.3g} rad/s from the "
            "first half to the second"
        )


def _require_headings(log: RunLog) -> None:
    if log.is_valid.any() and not log.has_heading.any():
        raise LogError(
            f"run {log.run!r}: has no headings: steady stretches need phi, --method drive does not"
        )
    if log.has_heading.any() and not log.has_place.any():
        raise LogError(
            f"run {log.run!r}: has no positions: steady stretches need x and y, --method drive "
            "does not"
        )


def _turns(omega: Array, first: int, last: int) -> bool:
    """Whether a sprocket turns faster from row `first` to row `last` than encoder noise
    explains.
    """
    of_stretch = omega[first : last + 1]
    fastest = float(np.abs(omega).max())
    noise = float(of_stretch.std(axis=0).max())
    speed = float(np.abs(of_stretch.mean(axis=0)).max())
    return speed > max(STANDING, _RESTING * fastest, noise)


def load_pieces(part: SteadyPart) -> tuple[SteadyPart, ...]:
    """Divide a stretch into equal pieces in which the load changes little; if the load is unknown,
    into one piece.

    On a slope the load turns relative to the robot, and the twist varies with the load: no arc fits
    the whole stretch.
    """
    if part.log.load is None:
        return (part,)
    load = part.log.load[part.rows]
    load = load[np.isfinite(load).all(axis=1)]
    begin, end = part.window

    # as many pieces as the change of load needs and the poses allow
    change = np.diff(load, axis=0)
    changed = float(np.hypot(change[:, 0], change[:, 1]).sum()) if len(load) > 1 else 0.0
    wanted = int(np.ceil(changed / _LOAD_CHANGE))
    poses = int((part.rows & part.log.has_heading).sum())
    most = min(int((end - begin) / _SHORTEST_PIECE), poses // (MIN_ARC_POSES + 1))
    count = max(1, min(wanted, most))
    if count == 1:
        return (part,)
    edges = np.linspace(begin, end, count + 1).tolist()
    return tuple(
        replace(part, name=f"{part.log.run} @ {first:.1f} s", window=(first, last))
        for first, last in itertools.pairwise(edges)
    )


def constant_stretches(
    time: Array, omega: Array, breaks: np.ndarray, least: float
) -> tuple[list[tuple[int, int]], tuple[int, int]]:
    """First and last rows of all stretches of at least `least` [s], in order, and of the longest,
    however short.

    Stretches neither overlap nor extend across `breaks`, the rows after which a new section begins.
    In each section the longest stretch is chosen first, then the longest in the remaining rows, and
    so on.
    """
    # means of sprocket speeds over blocks of each section
    step = float(np.median(np.diff(time)))
    size = max(1, round(min(_BLOCK / step, len(time))))  # rows of a block
    edges = np.concatenate([[0], breaks + 1, [len(time)]]).tolist()
    sections = list(itertools.pairwise(edges))
    means = [_block_means(omega[first:end], size) for first, end in sections]

    # variation of the means that is allowed
    fastest = max(float(np.abs(mean).max()) for mean in means)
    floor = _DRIFT * _SLOW * fastest
    jitter = 1.4826 * float(np.median(np.abs(np.diff(omega, axis=0)))) / np.sqrt(2)
    noise = _NOISE * jitter / np.sqrt(size)

    stretches = list[tuple[int, int]]()
    longest = (0, 0)
    for (first, end), mean in zip(sections, means, strict=True):
        begin = first + size * np.arange(len(mean))  # first and last rows of the blocks
        last = np.append(begin[1:], end) - 1
        furthest = _furthest(mean, floor, noise)
        left = [(0, len(mean) - 1)]  # first and last blocks of what remains
        while left:
            low, high = left.pop()
            to = np.minimum(furthest[low : high + 1], high)
            duration = time[last[to]] - time[begin[low : high + 1]]
            k = int(np.argmax(duration))
            stretch = int(begin[low + k]), int(last[to[k]])
            if duration[k] > time[longest[1]] - time[longest[0]]:
                longest = stretch
            if duration[k] < least:
                continue
            stretches.append(stretch)
            before = (low, low + k - 1)
            after = (int(to[k]) + 1, high)
            left += [part for part in (before, after) if part[0] <= part[1]]
    return sorted(stretches), longest


def _block_means(values: Array, size: int) -> Array:
    """Means (blocks, 2) of values (T, 2) over blocks of `size` rows; the last block includes the
    remainder.
    """
    blocks = max(1, len(values) // size)
    starts = np.arange(blocks) * size
    counts = np.diff(np.append(starts, len(values)))
    return np.add.reduceat(values, starts, axis=0) / counts[:, None]


def _furthest(mean: Array, floor: float, noise: float) -> np.ndarray:
    """Last block (n,) for each first block up to which neither column of `mean` (n, 2) varies too
    much.

    The allowed variation is a share of the faster sprocket's speed, or `floor` if larger, plus
    `noise`. It grows more slowly than the variation, so a later first block never has an earlier
    last block.
    """
    furthest = np.empty(len(mean), int)
    end = 0
    for first in range(len(mean)):
        end = max(first, end)
        low = mean[first : end + 1].min(axis=0)
        high = mean[first : end + 1].max(axis=0)
        for block in mean[end + 1 :]:
            low = np.minimum(low, block)
            high = np.maximum(high, block)
            speed = max(np.abs(low).max(), np.abs(high).max())
            if (high - low).max() > max(_DRIFT * speed, floor) + noise:
                break
            end += 1
        furthest[first] = end
    return furthest
