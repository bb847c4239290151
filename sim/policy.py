"""Trained policies, which are small NumPy networks from observations to actions, and a controller
that uses them.

A policy for path tracking corrects the reference's twist: action = twist now + authority *
network(features), clipped to [-1, 1]. The features are the observation with errors compressed by
arsinh, which resolves both millimetres and decimetres.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any, ClassVar, Self

import numpy as np
from numpy.typing import ArrayLike

from sim.path_tracking.config import PERIOD, EnvConfig, TrackingLayout
from sim.settings import from_options
from sim.task import Element
from trackslip.errors import InvalidValueError, LogError, TrackslipError, require
from trackslip.files import read_arrays
from trackslip.kinematics import Array
from trackslip.metrics import body_errors
from trackslip.trajectory.base import Reference

_PRODUCTS = 100_000  # number of products of rows and weights that fit into a processor's cache
ERRORS, TWIST_NOW = slice(0, 3), slice(3, 5)  # slices of an observation
# errors at which compression sets in, in the observation's units
FINE = np.array([0.02, 0.02, 0.02])
_OPSET = 18
_FEATURES = """
    errors, twist, others = Split <axis = 1> (observation, sizes)
    ratios = Div (errors, fine)
    compressed = Asinh (ratios)
    hidden0 = Concat <axis = 1> (compressed, twist, others)
"""
_CORRECTED = """
    correction = Clip (output, low, high)
    scaled = Mul (correction, authority)
    sum = Add (scaled, twist)
    action = Clip (sum, low, high)
"""


@dataclass(frozen=True)
class Network:
    """Layers with tanh, and a linear last layer. Rows are bitwise independent of each other."""

    weights: tuple[Array, ...]  # (in, out) each
    biases: tuple[Array, ...]  # (out,) each

    def __post_init__(self) -> None:
        shapes, layers = [weight.shape for weight in self.weights], (*self.weights, *self.biases)
        fit = (
            layers
            and all(len(shape) == 2 for shape in shapes)
            and all(b[0] == a[1] for a, b in pairwise(shapes))
        )
        fit = fit and [bias.shape for bias in self.biases] == [shape[1:] for shape in shapes]
        finite = all(layer.dtype.kind == "f" and np.isfinite(layer).all() for layer in layers)
        require(
            fit and finite, "layers", shapes, "one or more of finite numbers, that fit each other"
        )

    def __call__(self, x: Array) -> Array:
        """Outputs (N, m) for inputs (N, n)."""
        for k, (weight, bias) in enumerate(zip(self.weights, self.biases, strict=True)):
            # a matrix product would round differently for different N; blocks of rows limit the
            # memory
            rows = max(1, _PRODUCTS // weight.size)
            blocks = [x[first : first + rows] for first in range(0, max(len(x), 1), rows)]
            x = (
                np.concatenate(
                    [np.add.reduce(block[:, :, None] * weight, axis=1) for block in blocks]
                )
                + bias
            )
            if k < len(self.weights) - 1:
                x = np.tanh(x)
        return x

    @property
    def shape(self) -> tuple[int, int]:
        """Number of inputs and number of outputs."""
        return len(self.weights[0]), len(self.biases[-1])


@dataclass(frozen=True)
class Policy:
    """A trained policy for robots that cross courses."""

    FORMAT: ClassVar[str] = "trackslip crossing policy 1"

    network: Network
    """Network from observations to actions in [-1, 1]."""
    options: dict[str, Any]
    """Options of the environment that define observations and actions."""

    def action(self, observation: ArrayLike) -> Array:
        """Actions (N, A) in [-1, 1] for observations (N, n)."""
        return np.clip(self.network(np.asarray(observation, float)), -1.0, 1.0)

    def save(self, path: Path) -> None:
        """Write the policy to a .npz file."""
        arrays: dict[str, Any] = {
            f"weight_{k}": weight for k, weight in enumerate(self.network.weights)
        }
        arrays |= {f"bias_{k}": bias for k, bias in enumerate(self.network.biases)}
        about = {"format": self.FORMAT} | {
            name: value for name, value in vars(self).items() if name != "network"
        }
        with path.open("wb") as file:
            np.savez(file, about=np.array(json.dumps(about)), **arrays)

    @classmethod
    def load(cls, path: Path) -> Self:
        """Read a policy file, or policy.npz in a folder, without using pickle; raises LogError for
        other files.
        """
        file = policy_file(path)
        try:
            stored = read_arrays(file)
            about = json.loads(str(stored["about"]))
            require(about["format"] == cls.FORMAT, "format", about.pop("format"), f"{cls.FORMAT!r}")
            layers = range(sum(name.startswith("weight_") for name in stored))
            weights, biases = (
                tuple(stored[f"{part}_{k}"] for k in layers) for part in ("weight", "bias")
            )
            return from_options(cls, {"network": Network(weights, biases)} | about)
        except InvalidValueError as error:
            raise LogError(f"{file}: {error}") from error
        except LogError:  # it takes too much memory
            raise
        except OSError as error:
            raise LogError(f"{file}: {error.strerror or error}") from error
        except Exception as error:  # any error of NumPy, zipfile and json for a damaged file
            raise LogError(
                f"{file}: not a policy.npz of `trackslip train`: docs/controller.md has others"
            ) from error


@dataclass(frozen=True)
class TrackingPolicy(Policy):
    """A trained policy for robots that follow paths; its network turns features into corrections in
    [-1, 1].
    """

    FORMAT: ClassVar[str] = "trackslip policy 1"

    authority: tuple[float, float]
    """Largest correction to (v, w), in units of the environment's `twist_scale` [-]."""

    def __post_init__(self) -> None:
        valid = len(self.authority) == 2 and np.isfinite(self.authority).all()
        require(valid, "authority", self.authority, "two finite numbers")

    def action(self, observation: ArrayLike) -> Array:
        """Actions (N, 2) in [-1, 1] for observations (N, n)."""
        seen = np.asarray(observation, float)
        return corrected(seen, self.network(features(seen)), self.authority)


def policy_file(path: Path) -> Path:
    """The file of a policy, from its own path or that of the folder from `trackslip train`."""
    return path / "policy.npz" if path.is_dir() else path


def features(observation: Array) -> Array:
    """Features (..., n), the network's inputs, for observations (..., n)."""
    seen = np.array(observation, float)
    seen[..., ERRORS] = np.arcsinh(seen[..., ERRORS] / FINE)
    return seen


def corrected(observation: Array, correction: Array, authority: ArrayLike) -> Array:
    """Actions (N, 2): the reference's current twist in observations (N, n), plus corrections (N, 2)
    in [-1, 1].
    """
    return np.clip(
        observation[:, TWIST_NOW] + np.clip(correction, -1.0, 1.0) * np.asarray(authority),
        -1.0,
        1.0,
    )


class PolicyController:
    """A controller that builds the environment's observations from poses and applies a policy to
    them.
    """

    def __init__(self, policy: TrackingPolicy, top_speed: float) -> None:
        """Use sprockets with this `top_speed` [rad/s]; raises InvalidValueError for a policy of
        another environment.
        """
        config = from_options(EnvConfig, policy.options)
        require(
            not config.loads,
            "loads of the policy",
            config.loads,
            "false: controllers sense no loads",
        )
        self._policy, self._layout = policy, TrackingLayout(config, top_speed)
        shape, seen = policy.network.shape, len(self._layout.elements)
        require(shape == (seen, 2), "network of the policy", shape, f"from {seen} inputs to 2")
        self._scale = np.array(config.twist_scale)
        self.reset()

    def reset(self) -> None:
        """Assume sprockets at rest and no previous action."""
        self._omega: Array = np.zeros(2)
        self._action: Array = np.zeros(2)

    def sense(self, omega: Array) -> None:
        """Set the measured mean sprocket speeds (N, 2) over the last period [rad/s]."""
        self._omega = omega

    def twist(self, time: float, pose: ArrayLike, reference: Reference) -> Array:
        """Twists (N, 2) for measured poses (N, 3) [m/s, rad/s]."""
        error = body_errors(pose, reference.pose(time))
        ahead = reference.twist(time + self._layout.steps * PERIOD)
        twists = np.broadcast_to(ahead, (len(error), *ahead.shape))
        omega, action = (
            np.broadcast_to(pair, (len(error), 2)) for pair in (self._omega, self._action)
        )
        self._action = self._policy.action(self._layout.observation(error, twists, omega, action))
        return self._action * self._scale


def write_onnx(
    path: Path, policy: Policy, observed: Sequence[Element], commanded: Sequence[Element]
) -> None:
    """Write a policy as a graph from `observation` (N, n) to `action` (N, A), both float32.

    The model's metadata contain, as JSON, names, units, scales and bounds of both, and the
    environment's options. Raises TrackslipError if the package onnx isn't installed.
    """
    try:
        import onnx.parser
    except ImportError as error:
        raise TrackslipError(f'{path}: {error}; pip install -e ".[rl]"') from error
    before, after = "hidden0 = Identity (observation)", "action = Clip (output, low, high)"
    constants: dict[str, Any] = {"low": np.float32(-1.0), "high": np.float32(1.0)}
    if isinstance(policy, TrackingPolicy):
        before, after = _FEATURES, _CORRECTED
        sizes = ERRORS.stop, TWIST_NOW.stop - ERRORS.stop, len(observed) - TWIST_NOW.stop
        constants |= {
            "sizes": np.array(sizes),
            "fine": np.float32(FINE),
            "authority": np.array(policy.authority, np.float32),
        }
    layers = []
    for k, (weight, bias) in enumerate(
        zip(policy.network.weights, policy.network.biases, strict=True)
    ):
        constants |= {f"weight{k}": np.float32(weight), f"bias{k}": np.float32(bias)}
        layers += [
            f"layer{k} = Gemm (hidden{k}, weight{k}, bias{k})",
            f"hidden{k + 1} = Tanh (layer{k})",
        ]
    layers[-1] = f"output = Identity (layer{k})"
    ends = f"policy (float[N, {len(observed)}] observation) => (float[N, {len(commanded)}] action)"
    graph = onnx.parser.parse_graph(f"{ends} {{ {before} {' '.join(layers)} {after} }}")
    graph.initializer.extend(
        onnx.numpy_helper.from_array(np.asarray(value), name) for name, value in constants.items()
    )
    opset = onnx.helper.make_opsetid("", _OPSET)
    model = onnx.helper.make_model_gen_version(
        graph, producer_name="trackslip", opset_imports=[opset]
    )
    about = {
        "observation": [asdict(each) for each in observed],
        "action": [asdict(each) for each in commanded],
    }
    onnx.helper.set_model_props(
        model, {k: json.dumps(v) for k, v in (about | {"options": policy.options}).items()}
    )
    onnx.checker.check_model(model)
    path.write_bytes(model.SerializeToString())
