"""Whether robots stay where they are put."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from sim.drive.pull import Pull
from sim.ground.ground import Ground
from trackslip.errors import require
from trackslip.kinematics import Array

_AT_REST = 0.005  # a robot slower than this is at rest; creep is a hundred times slower [m/s]
_UPRIGHT = 0.1  # a robot with less roll and pitch than this stands on its tracks [rad]


def require_held(
    grounds: Sequence[Ground], friction: Array, heading: Array, pull: Pull, weight: float, motors: Array
) -> None:
    """Raise InvalidValueError if one of R robots would slide down or be dragged backwards from rest.

    They are on `grounds` (R,), with `friction` (R, 2) along and across the tracks where they stand, and with headings
    (R,) [rad]. Each has a `weight` [N], and its `motors` (R,) hold both tracks together against a force [N].
    """
    for ground, each, phi, force in zip(grounds, friction, heading.tolist(), motors.tolist(), strict=True):
        _require_held(ground, each, phi, pull, weight, force)


def _require_held(ground: Ground, friction: Array, heading: float, pull: Pull, weight: float, motors: float) -> None:
    ground.require_parking(friction, heading)
    if pull.force == 0:
        return
    along, across = (float(value) for value in friction)
    normal, uphill = weight * math.cos(ground.slope), ground.uphill - heading
    sideways = math.tan(ground.slope) * math.sin(uphill) / across
    held = min(along * normal * math.sqrt(1 - sideways**2), motors)
    most = held - weight * math.sin(ground.slope) * math.cos(uphill)
    require(pull.force < most, "pull", pull.force, f"less than {most:.4g} N, not to drag the robot backwards from rest")


def require_at_rest(grounds: Sequence[Ground], heading: Array, speed: Array, lean: Array, pull: Pull) -> None:
    """Raise InvalidValueError if one of R robots slides or has tipped over where it was put.

    They are on `grounds` (R,) with a `heading` [rad], `speed` [m/s] and `lean` [rad], (R,) each.
    """
    for k in map(int, np.flatnonzero(~(speed < _AT_REST) | ~(lean < _UPRIGHT))):
        what = "slides" if lean[k] < _UPRIGHT else "tips over"
        field, value = ("pull", pull.force) if pull.force > 0 else ("slope", grounds[k].slope)
        allowed = f"less, to park with heading {round(float(heading[k]), 3) + 0:g} rad: the robot {what}"
        require(False, field, value, allowed)
