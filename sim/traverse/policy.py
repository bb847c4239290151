"""The scripted controller, which crosses courses with flipper reflexes."""

from __future__ import annotations

from typing import Any, Final

import numpy as np

from sim.robot.tracked_model import FlipperGeometry
from sim.traverse.world import Command, Traverse
from trackslip import se2
from trackslip.arguments import checks_arguments
from trackslip.kinematics import Array

SAMPLES: Final = np.array([1.0, 1.25, 1.5])
"""Distances from the hinge at which a reflex samples the ground, in flipper lengths."""
OPTIONS: Final[dict[str, Any]] = {"action": "correction", "flippers": "pairs", "period": 0.2}
"""Fields of `TraverseConfig` for the training of policies."""
REACH: Final = 1.3
"""Largest angle of front flippers above the chassis' plane, and of rear flippers below it [rad]."""
PUSH: Final = 2.0
"""Angle by which rear flippers push down, per pitch beyond the ground's slope plus `TOLERATED`
[-].
"""
TOLERATED: Final = 0.12
"""Pitch beyond the ground's slope at which rear flippers begin to push [rad]."""
_SPEED: Final = 0.4  # belt speed forwards, of robots that are so fast [m/s]
_POSITION_GAIN: Final = 0.3  # belt speed per distance from the centre line [1/s]
_HEADING_GAIN: Final = 0.45  # belt speed per heading [m/s]
_TURN: Final = 0.3  # largest deviation of a belt's speed from the mean of left and right [m/s]


@checks_arguments
def scripted(world: Traverse) -> Command:
    """Set points for all robots in `world`, which drive along y = 0 with reflexes for their
    flippers.
    """
    state = world.state
    wanted = -_POSITION_GAIN * state.position[:, 1] - _HEADING_GAIN * state.heading
    turn = np.clip(wanted, -_TURN, _TURN)
    forwards = min(_SPEED, world.top_speed)
    speed = forwards + turn[:, None] * np.array([-1.0, 1.0])
    return Command(speed, reflex(world))


def reflex(world: Traverse) -> Array:
    """Set points (N, F) for the flipper angles of all robots in `world`, tips up [rad]; see
    `reflex_angles`.
    """
    geometry = world.flippers
    state = world.state
    offset = np.einsum("nij,fj->nfi", state.rotation, geometry.hinge)
    hinge = state.position[:, None] + offset  # (N, F, 3)

    # points on the ground ahead of front flippers, and behind rear ones
    outwards = np.where(geometry.front, 1.0, -1.0)
    distance = outwards[:, None] * SAMPLES * geometry.length[:, None]  # (F, S)
    ahead = se2.direction(state.heading)[:, None, None]
    points = hinge[:, :, None, :2] + distance[..., None] * ahead  # (N, F, S, 2)
    ground = world.elevation(points.reshape(world.size, -1, 2))
    by_flipper = ground.reshape(world.size, *distance.shape)
    return reflex_angles(by_flipper, state.pitch, hinge[..., 2], geometry)


def reflex_angles(
    ground: Array, pitch: Array, hinge_height: Array, geometry: FlipperGeometry
) -> Array:
    """Set points (N, F) for the flipper angles, tips up [rad].

    Front flippers rise as far as the ground ahead requires. Rear flippers stay in line with the
    chassis, which keeps the robot from tipping backwards, and reach down to the ground behind when
    the robot crosses an edge. If the chassis pitches up more than the ground rises from rear to
    front, as on a step, rear flippers push the chassis level.

    Args:
        ground: heights (N, F, S) of the ground at `SAMPLES` from the hinges, along the flippers'
            directions [m].
        pitch: angles (N,) by which the chassis points upwards [rad].
        hinge_height: heights (N, F) of the hinges [m].
        geometry: shape of the F flippers.
    """
    # angle, up from the hinge, of a flipper whose underside, `radius` below its centre line,
    # touches this ground
    away = SAMPLES * geometry.length[:, None]  # (F, S)
    rise = ground - hinge_height[..., None]
    distance = np.hypot(away, rise)
    above_ground = np.arcsin(np.minimum(geometry.radius[:, None] / distance, 1.0))
    slope = (np.arctan2(rise, away) + above_ground).max(axis=-1)

    # in the chassis' frame, within reach
    outwards = np.where(geometry.front, 1.0, -1.0)
    low = np.where(geometry.front, 0.0, -REACH)
    high = np.where(geometry.front, REACH, 0.0)
    lift = np.clip(slope - outwards * pitch[:, None], low, high)

    # rear flippers push against a pitch that the ground doesn't explain
    unexplained = np.maximum(pitch - _grade(ground, geometry) - TOLERATED, 0.0)
    push = np.where(geometry.front, 0.0, PUSH * unexplained[:, None])
    return np.maximum(lift - push, low) - geometry.rest


def _grade(ground: Array, geometry: FlipperGeometry) -> Array:
    """Slopes (N,) from the ground behind the rear flippers to the ground ahead of the front ones
    [rad].
    """
    front = geometry.front
    if front.all() or not front.any():
        return np.zeros(len(ground))
    outwards = np.where(front, 1.0, -1.0)
    place = geometry.hinge[:, 0] + outwards * SAMPLES.mean() * geometry.length
    height = ground.mean(axis=-1)
    rise = height[:, front].mean(axis=1) - height[:, ~front].mean(axis=1)
    run = place[front].mean() - place[~front].mean()
    return np.asarray(np.arctan2(rise, run))
