"""Trained policies: small NumPy networks from observations to actions, their files, and a controller that uses one.

A policy of path tracking corrects the reference's twist: action = twist now + authority * network(features), clipped to
[-1, 1]. The features are the observation with its errors compressed by arsinh, which resolves both millimetres and
decimetres.
"""

from __future__ import annotations

import json
import reprlib
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from sim.path_tracking.config import PERIOD, EnvConfig, TrackingLayout
from sim.settings import from_options
from sim.task import Element
from trackslip.errors import LogError, TrackslipError, require
from trackslip.files import regular_file
from trackslip.kinematics import Array
from trackslip.laws.file import number
from trackslip.metrics import body_errors
from trackslip.trajectory.base import Reference

_PRODUCTS = 100_000  # of rows and weights at a time, which fit into a processor's cache
_FORMAT, _CROSSING = "trackslip policy 1", "trackslip crossing policy 1"
ERRORS, TWIST_NOW = slice(0, 3), slice(3, 5)  # of an observation
FINE = np.array([0.02, 0.02, 0.02])  # errors at which the compression sets in, in the observation's units
_OPSET = 18


@dataclass(frozen=True)
class Network:
    """Layers with tanh, except the last, which is linear. Rows are bitwise independent."""

    weights: tuple[Array, ...]  # (in, out) each
    biases: tuple[Array, ...]  # (out,) each

    def __call__(self, x: Array) -> Array:
        """Outputs (N, m) of inputs (N, n)."""
        for k, (weight, bias) in enumerate(zip(self.weights, self.biases, strict=True)):
            # a matrix product would round differently for different N; blocks of rows bound the memory
            rows = max(1, _PRODUCTS // weight.size)
            blocks = [x[first : first + rows] for first in range(0, max(len(x), 1), rows)]
            x = np.concatenate([np.add.reduce(block[:, :, None] * weight, axis=1) for block in blocks]) + bias
            if k < len(self.weights) - 1:
                x = np.tanh(x)
        return x

    @property
    def shape(self) -> tuple[int, int]:
        """Numbers of inputs and outputs."""
        return len(self.weights[0]), len(self.biases[-1])

    def save(self, path: Path, about: dict[str, Any]) -> None:
        """Write a .npz file with the network and `about`, whose `format` says what it is."""
        arrays: dict[str, Any] = {f"weight_{k}": weight for k, weight in enumerate(self.weights)}
        arrays |= {f"bias_{k}": bias for k, bias in enumerate(self.biases)}
        with path.open("wb") as file:
            np.savez(file, about=np.array(json.dumps(about)), **arrays)


def load_network(path: Path, kind: str, *fields: str) -> tuple[Network, list[Any]]:
    """Read a file of the format `kind`, or policy.npz in a folder, without pickle: its network and some more `fields`.

    Raises LogError for any other file.
    """
    file = policy_file(path)
    try:
        with regular_file(file).open("rb") as opened, np.load(opened) as stored:
            about = json.loads(str(stored["about"]))
            if about["format"] != kind:
                raise LogError(f"{file}: its format is {about['format']!r}, not {kind!r}")
            layers = sum(name.startswith("weight_") for name in stored.files)
            weights, biases = (tuple(stored[f"{part}_{k}"] for k in range(layers)) for part in ("weight", "bias"))
            if not _fit(weights, biases):
                raise LogError(f"{file}: its layers must hold finite numbers and fit each other")
            return Network(weights, biases), [about[name] for name in fields]
    except LogError:
        raise
    except OSError as error:
        raise LogError(f"{file}: {error.strerror or error}") from error
    except Exception as error:  # whatever NumPy, zipfile and json raise for a damaged file
        raise LogError(f"{file}: not a policy of `trackslip train`: docs/controller.md has others") from error


def _fit(weights: Sequence[Array], biases: Sequence[Array]) -> bool:
    """True for one or more layers of finite numbers, each of which takes what the one before gives."""
    shapes = [weight.shape for weight in weights]
    chained = all(len(shape) == 2 for shape in shapes) and all(b[0] == a[1] for a, b in pairwise(shapes))
    return (
        len(shapes) > 0
        and chained
        and [bias.shape for bias in biases] == [shape[1:] for shape in shapes]
        and all(layer.dtype.kind == "f" and np.isfinite(layer).all() for layer in (*weights, *biases))
    )


def policy_file(path: Path) -> Path:
    """The file of a policy, given by its path or by the folder that `trackslip train` wrote."""
    return path / "policy.npz" if path.is_dir() else path


def features(observation: Array) -> Array:
    """Inputs (..., n) of the network for observations (..., n)."""
    seen = np.array(observation, float)
    seen[..., ERRORS] = np.arcsinh(seen[..., ERRORS] / FINE)
    return seen


def corrected(observation: Array, correction: Array, authority: ArrayLike) -> Array:
    """Actions (N, 2): the reference's present twist in observations (N, n), plus corrections (N, 2) in [-1, 1]."""
    return np.clip(observation[:, TWIST_NOW] + np.clip(correction, -1.0, 1.0) * np.asarray(authority), -1.0, 1.0)


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
        self.network.save(path, {"format": _FORMAT, "authority": list(self.authority), "options": self.options})

    @classmethod
    def load(cls, path: Path) -> Policy:
        """Read a file written by `save`, or policy.npz in a folder; raises LogError for any other file."""
        network, (authority, options) = load_network(path, _FORMAT, "authority", "options")
        v, w = (number(authority, k) for k in range(2))
        if v is None or w is None:
            raise LogError(f"{path}: authority = {reprlib.repr(authority)}: must be two finite numbers")
        return cls(network, (v, w), options)


@dataclass(frozen=True)
class CrossingPolicy:
    """The result of a training: the network, and the environment that it was trained in."""

    network: Network
    """From observations to actions in [-1, 1]."""
    options: dict[str, Any]
    """Fields of `TraverseConfig` on which observations and actions depend."""

    def action(self, observation: ArrayLike) -> Array:
        """Actions (N, A) in [-1, 1] for observations (N, n)."""
        return np.clip(self.network(np.asarray(observation, float)), -1.0, 1.0)

    def save(self, path: Path) -> None:
        """Write a .npz file."""
        self.network.save(path, {"format": _CROSSING, "options": self.options})

    @classmethod
    def load(cls, path: Path) -> CrossingPolicy:
        """Read a file written by `save`, or policy.npz in a folder; raises LogError for any other file."""
        network, (options,) = load_network(path, _CROSSING, "options")
        return cls(network, options)


class PolicyController:
    """A policy as a controller, which builds the environment's observations from poses."""

    def __init__(self, policy: Policy, top_speed: float) -> None:
        """`top_speed`: of the sprockets [rad/s]. Raises InvalidValueError for a policy of another environment."""
        config = from_options(EnvConfig, policy.options)
        require(not config.loads, "loads of the policy", config.loads, "false: controllers sense no loads")
        self._policy, self._layout = policy, TrackingLayout(config, top_speed)
        shape, seen = policy.network.shape, len(self._layout.elements)
        require(shape == (seen, 2), "network of the policy", shape, f"from {seen} inputs to 2")
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


def write_onnx(
    path: Path, policy: Policy | CrossingPolicy, observed: Sequence[Element], commanded: Sequence[Element]
) -> None:
    """Write a policy as a graph from `observation` (N, n) to `action` (N, A), both float32.

    The model's metadata have, as JSON, the names, units, scales and bounds of both, and the environment's options.
    Raises TrackslipError if the package onnx is missing.
    """
    try:
        import onnx
    except ImportError as error:
        raise TrackslipError(f'{path}: {error}; pip install -e ".[rl]"') from error
    graph = _Graph(onnx)
    if isinstance(policy, CrossingPolicy):
        graph.add("Clip", _layers(graph, policy.network, "observation"), -1.0, 1.0, output="action")
    else:
        errors = graph.add("Div", graph.columns("observation", ERRORS), FINE)
        others = graph.columns("observation", slice(ERRORS.stop, len(observed)))
        features = graph.add("Concat", graph.add("Asinh", errors), others, axis=1)
        correction = graph.add("Clip", _layers(graph, policy.network, features), -1.0, 1.0)
        scaled = graph.add("Mul", correction, policy.authority)
        action = graph.add("Add", scaled, graph.columns("observation", TWIST_NOW))
        graph.add("Clip", action, -1.0, 1.0, output="action")
    model = graph.model(len(observed), len(commanded))
    about = {"observation": [asdict(each) for each in observed], "action": [asdict(each) for each in commanded]}
    onnx.helper.set_model_props(model, {k: json.dumps(v) for k, v in (about | {"options": policy.options}).items()})
    onnx.checker.check_model(model)
    path.write_bytes(model.SerializeToString())


def _layers(graph: _Graph, network: Network, values: str) -> str:
    for k, (weight, bias) in enumerate(zip(network.weights, network.biases, strict=True)):
        values = graph.add("Gemm", values, weight, bias)
        if k < len(network.weights) - 1:
            values = graph.add("Tanh", values)
    return values


class _Graph:
    def __init__(self, onnx: Any) -> None:
        self._onnx = onnx
        self._nodes: list[Any] = []
        self._constants: list[Any] = []

    def add(self, kind: str, *inputs: Any, output: str = "", **attributes: Any) -> str:
        """Add a node; inputs are names of values, or constants. Returns the name of its output."""
        names = [value if isinstance(value, str) else self._constant(np.float32(value)) for value in inputs]
        output = output or f"value{len(self._nodes)}"
        self._nodes.append(self._onnx.helper.make_node(kind, names, [output], **attributes))
        return output

    def columns(self, values: str, chosen: slice) -> str:
        """Some columns of values (N, n)."""
        first, last, axis = (self._constant(np.array([k])) for k in (chosen.start, chosen.stop, 1))
        return self.add("Slice", values, first, last, axis)

    def model(self, observed: int, commanded: int) -> Any:
        """The model."""
        helper, kind = self._onnx.helper, self._onnx.TensorProto.FLOAT
        ends = (("observation", observed), ("action", commanded))
        given, result = (helper.make_tensor_value_info(name, kind, ["N", count]) for name, count in ends)
        graph = helper.make_graph(self._nodes, "policy", [given], [result], self._constants)
        opset = helper.make_opsetid("", _OPSET)
        return helper.make_model_gen_version(graph, producer_name="trackslip", opset_imports=[opset])

    def _constant(self, values: Any) -> str:
        name = f"constant{len(self._constants)}"
        self._constants.append(self._onnx.numpy_helper.from_array(np.asarray(values), name))
        return name
