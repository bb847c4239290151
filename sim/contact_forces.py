"""Forces and sliding velocities at the contact points of a fleet."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sim.fleet import Fleet
from sim.robot.robot import CONTACT_WIDTH
from trackslip import se2
from trackslip.kinematics import Array


@dataclass(frozen=True)
class Contacts:
    """Contact forces and sliding at K points of N robots, one physics step ago."""

    load: Array  # (N, K) normal force [N]
    force: Array  # (N, K, 2) tangential force on the robot, along and across the pad [N]
    velocity: Array  # (N, K, 2) of the robot's points relative to the ground, likewise [m/s]
    rising: Array  # (N, K) vertical speed, positive upwards [m/s]
    belt: Array  # (N, K) speed of the belt relative to the robot, along the pad [m/s]
    position: Array  # (N, K, 2) in the robot's frame [m]

    @property
    def sliding(self) -> Array:
        """Sliding velocity of the belts relative to the ground (N, K, 2) [m/s]."""
        return self.velocity + np.stack([self.belt, np.zeros_like(self.belt)], axis=-1)


def read_contacts(fleet: Fleet) -> Contacts:
    """Contacts of a fleet whose robot was loaded with contact sensors."""
    sensed = _of_points(fleet, fleet.batch.bind("sensordata"))
    return Contacts(
        load=sensed[..., 0].copy(),
        force=sensed[..., 1:3].copy(),
        velocity=sensed[..., 7:9].copy(),
        rising=sensed[..., 6].copy(),
        belt=np.repeat(fleet.belts / np.abs(fleet.robot.pad_sign), fleet.robot.points_per_pad, axis=1),
        position=se2.from_world(fleet.pose()[:, None], sensed[..., 3:5]),
    )


def pad_forces(fleet: Fleet) -> Array:
    """Mean forces (N, P, 3) of the ground on the pads over the last `advance`: forward, to the left, up [N].

    The fleet's robot must have been loaded with contact sensors.
    """
    sensed = _of_points(fleet, fleet.sensed)
    points = fleet.robot.points_per_pad
    along_across = sensed[..., 1:3] * np.repeat(np.sign(fleet.robot.pad_sign), points)[:, None]
    at_points = np.concatenate([along_across, sensed[..., :1]], axis=-1)
    return at_points.reshape(fleet.size, -1, points, 3).sum(axis=2)


def _of_points(fleet: Fleet, sensed: Array) -> Array:
    """What the contact sensors say of each point (N, K, CONTACT_WIDTH), from all sensors' data (N, S)."""
    points = len(fleet.robot.pad_side) * fleet.robot.points_per_pad
    return sensed[:, -points * CONTACT_WIDTH :].reshape(fleet.size, points, CONTACT_WIDTH)
