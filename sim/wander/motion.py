"""The true motion of a drive, and where the robot is between its rows."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from trackslip.kinematics import Array


@dataclass(frozen=True)
class Motion:
    """True poses over time."""

    time: Array  # (F,) [s], ascending
    pose: Array  # (F, 3) [m, m, rad], phi unwrapped

    def at(self, time: Array) -> Array:
        """Poses (..., 3) at times (...) within the motion, on an arc of constant twist between neighbouring rows."""
        k = np.clip(np.searchsorted(self.time, time, side="right") - 1, 0, len(self.time) - 2)
        share = (time - self.time[k]) / (self.time[k + 1] - self.time[k])
        place, heading = self.pose[:, 0] + 1j * self.pose[:, 1], self.pose[:, 2]
        turn = heading[k + 1] - heading[k]
        ahead = (place[k + 1] - place[k]) * np.exp(-1j * (heading[k] + turn / 2)) / _chord(turn)
        turned = share * turn
        there = place[k] + share * ahead * _chord(turned) * np.exp(1j * (heading[k] + turned / 2))
        return np.stack([there.real, there.imag, heading[k] + turned], axis=-1)


def steps_between(pose: Array) -> Array:
    """Relative poses (T - 1, 3) of neighbouring poses (T, 3), each in the frame of the one before; turns unwrapped."""
    place, heading = pose[:, 0] + 1j * pose[:, 1], pose[:, 2]
    ahead = np.diff(place) * np.exp(-1j * heading[:-1])
    return np.stack([ahead.real, ahead.imag, np.diff(heading)], axis=-1)


def joined(start: Array, steps: Array) -> Array:
    """Poses (T, 3) from the first (3,) and the steps (T - 1, 3) between them: the inverse of `steps_between`."""
    heading = start[2] + np.concatenate([[0.0], np.cumsum(steps[:, 2])])
    ahead = (steps[:, 0] + 1j * steps[:, 1]) * np.exp(1j * heading[:-1])
    place = start[0] + 1j * start[1] + np.concatenate([[0.0], np.cumsum(ahead)])
    return np.stack([place.real, place.imag, heading], axis=-1)


def arc_steps(twist: Array, duration: float) -> Array:
    """Relative poses (..., 3) after constant twists (..., 3), forward, lateral and yaw, of `duration` [s]."""
    turn = twist[..., 2] * duration
    ahead = (twist[..., 0] + 1j * twist[..., 1]) * duration * _chord(turn) * np.exp(0.5j * turn)
    return np.stack([ahead.real, ahead.imag, turn], axis=-1)


def _chord(turn: Array) -> Array:
    """Length of the chord (...) of an arc that turns by (...) [rad], over that of the arc."""
    return np.sinc(turn / (2 * np.pi))
