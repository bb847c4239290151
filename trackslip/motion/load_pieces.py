"""Pieces of a steady stretch under nearly constant load, which turns with the robot on a slope."""

from __future__ import annotations

import itertools
from dataclasses import replace

import numpy as np

from trackslip.motion.arc import MIN_ARC_POSES
from trackslip.motion.steady import SteadyPart

_CHANGE = 0.1  # change of the traction per unit load within a piece [-]
_SHORTEST = 1.5  # duration of a piece [s]


def load_pieces(part: SteadyPart) -> tuple[SteadyPart, ...]:
    """The stretch cut evenly into pieces, under each of which the load changes little; whole if that is not known.

    On a slope, the load turns with the robot and its twist varies with it: no arc fits the whole stretch.
    """
    if part.log.load is None:
        return (part,)
    load = part.log.load[part.rows]
    load = load[np.isfinite(load).all(axis=1)]
    begin, end = part.window
    changed = float(np.hypot(*np.diff(load, axis=0).T).sum()) if len(load) > 1 else 0.0
    poses = int((part.rows & part.log.has_heading).sum())
    most = min(int((end - begin) / _SHORTEST), poses // (MIN_ARC_POSES + 1))
    count = max(1, min(int(np.ceil(changed / _CHANGE)), most))
    if count == 1:
        return (part,)
    edges = np.linspace(begin, end, count + 1).tolist()
    return tuple(
        replace(part, name=f"{part.log.run} @ {first:.1f} s", window=(first, last))
        for first, last in itertools.pairwise(edges)
    )
