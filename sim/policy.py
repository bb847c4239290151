"""Trained policies: a small NumPy network from observations to actions, and a controller that uses it.

The network corrects the reference's twist: action = twist now + authority * network(features), clipped to [-1, 1]. The
features are the observation with its errors compressed by arsinh, which resolves both millimetres and decimetres.
"""

from __future__ import annotations

import json
import zipfile
import zlib
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from sim.path_tracking.config import PERIOD, EnvConfig
from sim.path_tracking.observation import Layout
from trackslip.errors import LogError
from trackslip.kinematics import Array
from trackslip.metrics import body_errors
from trackslip.trajectory.base import Reference

_FORMAT = "trackslip policy 1"
_DAMAGED = (
    *(KeyError, ValueError, TypeError, AttributeError, RecursionError),
    *(EOFError, NotImplementedError, zipfile.BadZipFile, zlib.error),
)
"""Exceptions raised when reading a file that is not a policy."""
_ERRORS, _TWIST_NOW = slice(0, 3), slice(3, 5)  # of an observation
_FINE = np.array([0.02, 0.02, 0.02])  # errors at which the compression sets in, in the observation's units


def features(observation: Array) -> Array:
    """Inputs (..., n) of the network for observations (..., n)."""
    seen = np.array(observation, float)
    seen[..., _ERRORS] = np.arcsinh(seen[..., _ERRORS] / _FINE)
    return seen


def corrected(observation: Array, correction: Array, authority: ArrayLike) -> Array:
    """Actions (N, 2): the reference's present twist in observations (N, n), plus corrections (N, 2) in [-1, 1]."""
    return np.clip(observation[:, _TWIST_NOW] + np.clip(correction, -1.0, 1.0) * np.asarray(authority), -1.0, 1.0)


@dataclass(frozen=True)
class Network:
    """Layers with tanh, except the last, which is linear. Rows are bitwise independent."""

    weights: tuple[Array, ...]  # (in, out) each
    biases: tuple[Array, ...]  # (out,) each

    def __call__(self, x: Array) -> Array:
        """Outputs (N, m) of inputs (N, n)."""
        for k, (weight, bias) in enumerate(zip(self.weights, self.biases, strict=True)):
            # a matrix product would round differently for different N
            x = np.add.reduce(x[:, :, None] * weight, axis=1) + bias
            if k < len(self.weights) - 1:
                x = np.tanh(x)
        return x


@dataclass(frozen=True)
class Policy:
    """The result of a training: the network, its authority, and the environment that it was trained in."""

    network: Network
    """From features to corrections in [-1, 1]."""
    authority: tuple[float, float]
    """Largest correction of (v, w), in units of the environment's `twist_scale` [-]."""
    options: dict[str, Any]
    """Fields of `EnvConfig` on which observations and actions depend."""

    def action(self, observation: ArrayLike) -> Array:
        """Actions (N, 2) in [-1, 1] for observations (N, n)."""
        seen = np.asarray(observation, float)
        return corrected(seen, self.network(features(seen)), self.authority)

    def save(self, path: Path) -> None:
        """Write a .npz file."""
        about = {"format": _FORMAT, "authority": list(self.authority), "options": self.options}
        arrays: dict[str, Any] = {f"weight_{k}": weight for k, weight in enumerate(self.network.weights)}
        arrays |= {f"bias_{k}": bias for k, bias in enumerate(self.network.biases)}
        with path.open("wb") as file:
            np.savez(file, about=np.array(json.dumps(about)), **arrays)

    @classmethod
    def load(cls, path: Path) -> Policy:
        """Read a file written by `save`, or policy.npz in a folder; raises LogError for any other file."""
        file = policy_file(path)
        try:
            with file.open("rb") as opened, np.load(opened, allow_pickle=False) as stored:
                about = json.loads(str(stored["about"]))
                if about["format"] != _FORMAT:
                    raise LogError(f"{file}: its format is {about['format']!r}, not {_FORMAT!r}")
                layers = sum(name.startswith("weight_") for name in stored.files)
                weights, biases = (tuple(stored[f"{part}_{k}"] for k in range(layers)) for part in ("weight", "bias"))
                forward, turning = about["authority"]
                return cls(Network(weights, biases), (float(forward), float(turning)), about["options"])
        except OSError as error:
            raise LogError(f"{file}: {error.strerror or error}") from error
        except LogError:
            raise
        except _DAMAGED as error:
            raise LogError(f"{file}: not a policy ({type(error).__name__}: {error})") from error


def policy_file(path: Path) -> Path:
    """The file of a policy, given by its path or by the folder that `trackslip train` wrote."""
    return path / "policy.npz" if path.is_dir() else path


class PolicyController:
    """A policy as a controller, which builds the environment's observations from poses."""

    def __init__(self, policy: Policy, top_speed: float) -> None:
        """`top_speed`: of the sprockets [rad/s]."""
        config = EnvConfig.of(policy.options)
        self._policy, self._layout = policy, Layout(config, top_speed)
        self._scale = np.array(config.twist_scale)
        self.reset()

    def reset(self) -> None:
        """Start with sprockets at rest and no previous action."""
        self._omega: Array = np.zeros(2)
        self._action: Array = np.zeros(2)

    def sense(self, omega: Array) -> None:
        """Set the measured sprocket speeds (N, 2), mean over the last period [rad/s]."""
        self._omega = omega

    def twist(self, time: float, pose: ArrayLike, reference: Reference) -> Array:
        """Twists (N, 2) for measured poses (N, 3) [m/s, rad/s]."""
        error = body_errors(pose, reference.pose(time))
        ahead = reference.twist(time + self._layout.steps * PERIOD)
        twists = np.broadcast_to(ahead, (len(error), *ahead.shape))
        omega, action = (np.broadcast_to(pair, (len(error), 2)) for pair in (self._omega, self._action))
        self._action = self._policy.action(self._layout.observation(error, twists, omega, action))
        return self._action * self._scale
