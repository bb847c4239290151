"""Wheels on one side of a robot, which have to turn alike."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from trackslip.errors import LogError
from trackslip.kinematics import Array
from trackslip.ros.angles import LIKE

_STILL = 0.01  # way over that of the wheel that turns most, below which a wheel's encoder is dead [-]
_MIN_WAY = 1.0  # of the wheel that turns most, for a judgement [rad]
_AGAINST = -0.5  # correlation below which wheels turn against each other [-]


def side_turns(topic: str, side: Sequence[str], turns: Mapping[str, Array], notes: list[str]) -> Array:
    """Mean turns (T,) [rad] in each interval of the wheels of a side, of those `turns` that are measured.

    An encoder that stands still while others turn is left out, and told. Raises LogError, with the topic and the names,
    if wheels turn against each other.
    """
    ways = {name: float(np.abs(turns[name]).sum()) for name in side}
    most = max(ways, key=lambda name: ways[name])
    dead = [name for name in side if ways[name] < _STILL * ways[most] and ways[most] > _MIN_WAY]
    notes += [f"topic {topic}: joint {name} left out: it stands still while {most} turns" for name in dead]
    kept = [name for name in side if name not in dead]
    reference = turns[most]
    for name in (name for name in kept if ways[most] > _MIN_WAY):
        together = float(turns[name] @ reference)
        if together < _AGAINST * float(np.linalg.norm(turns[name]) * np.linalg.norm(reference)):
            raise LogError(
                f"topic {topic}: joints {most} and {name} of one side turn against each other: "
                "choose with --left NAMES --right NAMES"
            )
        if not LIKE[0] < together / float(reference @ reference) < LIKE[1]:
            ratio = together / float(reference @ reference)
            notes.append(f"topic {topic}: joint {name} turns {ratio:.2g} times as fast as {most}: their mean is taken")
    return np.asarray(np.mean([turns[name] for name in kept], axis=0))
