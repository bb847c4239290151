"""Trained policies, which are small NumPy networks from observations to actions, and a controller
that uses them.

A policy for path tracking corrects the reference's twist: action = twist now + authority *
network(features), clipped to [-1, 1]. The features are the observation with errors compressed by
arsinh, which resolves both millimetres and decimetres.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass, fields
from itertools import pairwise
from pathlib import Path
from typing import Any, ClassVar, Final, Self

import numpy as np
from numpy.typing import ArrayLike

from sim.common.array_file import read_arrays, write_arrays
from sim.common.settings import from_options
from sim.learning.task import Element
from sim.path_tracking.config import PERIOD, EnvConfig, TrackingLayout
from sim.traverse.config import TraverseConfig
from trackslip.errors import InvalidValueError, LogError, TrackslipError, require
from trackslip.kinematics import Array
from trackslip.metrics import body_errors
from trackslip.trajectory.base import Reference

# number of products of rows and weights that fit into a processor's cache
_CACHED_PRODUCTS: Final = 100_000
ERRORS: Final = slice(0, 3)
"""Errors in an observation."""
TWIST_NOW: Final = slice(3, 5)
"""The reference's current twist in an observation."""
FINE: Final = np.array([0.02, 0.02, 0.02])
"""Errors at which compression sets in, in the observation's units."""
_OPSET: Final = 18  # version of ONNX's operators
# beginning and end of the graph of a policy for tracking: `features` and `corrected`
_FEATURES: Final = """
    errors, twist, others = Split <axis = 1> (observation, sizes)
    ratios = Div (errors, fine)
    compressed = Asinh (ratios)
    hidden0 = Concat <axis = 1> (compressed, twist, others)
"""
_CORRECTED: Final = """
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
        shapes = [weight.shape for weight in self.weights]
        allowed = "one or more of finite numbers, that fit each other"
        require(self._fits() and self._is_finite(), "layers", shapes, allowed)

    def _fits(self) -> bool:
        """Whether each layer takes what the one before it gives, and has a bias per output."""
        shapes = [weight.shape for weight in self.weights]
        are_matrices = all(len(shape) == 2 and min(shape) > 0 for shape in shapes)
        if not shapes or not are_matrices:
            return False
        connect = all(before[1] == after[0] for before, after in pairwise(shapes))
        biases = [bias.shape for bias in self.biases]
        return connect and biases == [shape[1:] for shape in shapes]

    def _is_finite(self) -> bool:
        layers = (*self.weights, *self.biases)
        return all(layer.dtype.kind == "f" and np.isfinite(layer).all() for layer in layers)

    def __call__(self, x: Array) -> Array:
        """Outputs (N, m) for inputs (N, n)."""
        last = len(self.weights) - 1
        for k, (weight, bias) in enumerate(zip(self.weights, self.biases, strict=True)):
            x = _product(x, weight) + bias
            if k < last:
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
    ENVIRONMENT: ClassVar[type[Any]] = TraverseConfig
    """Options of the environments that such policies are trained in."""
    DEFINING: ClassVar[tuple[str, ...]] = ("action", "flippers", "period", "noise")
    """The options that define observations and actions."""

    network: Network
    """Network from observations to actions in [-1, 1]."""
    options: dict[str, Any]
    """Options of the environment in which the policy was trained."""

    def __post_init__(self) -> None:
        known = [field.name for field in fields(self.ENVIRONMENT)]
        for name in self.options:
            require(name in known, "options", name, f"some of {', '.join(known)}")

    def environment(self) -> Any:
        """The options that define observations and actions, the others at their defaults.

        A policy's file comes from anywhere, so no function is imported and no file opened that its
        other options name. Raises InvalidValueError for values that aren't allowed, and for a
        policy that needs the user's own observations.
        """
        own = self.options.get("own_observations")
        allowed = (
            "empty: no code is imported that a policy's file names; only your own program or, for "
            "tracking, your own controller MODULE:CLASS can compute them"
        )
        require(not own, "own_observations of the policy", own, allowed)
        given = {name: self.options[name] for name in self.DEFINING if name in self.options}
        return from_options(self.ENVIRONMENT, given)

    def action(self, observation: ArrayLike) -> Array:
        """Actions (N, A) in [-1, 1] for observations (N, n)."""
        return np.clip(self.network(np.asarray(observation, float)), -1.0, 1.0)

    def save(self, path: Path) -> None:
        """Write the policy to a .npz file."""
        arrays = {}
        for k, weight in enumerate(self.network.weights):
            arrays[f"weight_{k}"] = weight
        for k, bias in enumerate(self.network.biases):
            arrays[f"bias_{k}"] = bias
        entries = {name: value for name, value in vars(self).items() if name != "network"}
        write_arrays(path, {"format": self.FORMAT} | entries, arrays)

    @classmethod
    def load(cls, path: Path) -> Self:
        """Read a policy file, or policy.npz in a folder; raises LogError for other files.

        Nothing that the file names is imported or opened.
        """
        file = policy_file(path)
        what = "a policy.npz of `trackslip train`: docs/controller.md has others"
        about, arrays = read_arrays(file, what)
        layers = range(sum(name.startswith("weight_") for name in arrays))
        weight_names = [f"weight_{k}" for k in layers]
        bias_names = [f"bias_{k}" for k in layers]
        names = [*weight_names, *bias_names]
        entries = [field.name for field in fields(cls) if field.name != "network"]
        try:
            format = about.pop("format", None)
            require(format == cls.FORMAT, "format", format, f"{cls.FORMAT!r}")
            require(set(about) == set(entries), "entries", sorted(about), ", ".join(entries))
            require(set(arrays) == set(names), "arrays", sorted(arrays), ", ".join(names))
            weights = tuple(arrays[name] for name in weight_names)
            biases = tuple(arrays[name] for name in bias_names)
            return from_options(cls, {"network": Network(weights, biases)} | about)
        except InvalidValueError as error:
            raise LogError(f"{file}: {error}") from error


@dataclass(frozen=True)
class TrackingPolicy(Policy):
    """A trained policy for robots that follow paths; its network turns features into corrections in
    [-1, 1].
    """

    FORMAT: ClassVar[str] = "trackslip policy 1"
    ENVIRONMENT: ClassVar[type[Any]] = EnvConfig
    DEFINING: ClassVar[tuple[str, ...]] = (
        "action",
        "twist_scale",
        "previews",
        "preview_spacing",
        "loads",
        "off_path",
    )

    authority: tuple[float, float]
    """Largest correction to (v, w), in units of the environment's `twist_scale` [-]."""

    def __post_init__(self) -> None:
        super().__post_init__()
        valid = len(self.authority) == 2 and np.isfinite(self.authority).all()
        require(valid, "authority", self.authority, "two finite numbers")

    def action(self, observation: ArrayLike) -> Array:
        """Actions (N, 2) in [-1, 1] for observations (N, n)."""
        seen = np.asarray(observation, float)
        return corrected(seen, self.network(features(seen)), self.authority)


def policy_file(path: Path) -> Path:
    """The file of a policy, from its own path or that of the folder from `trackslip train`.

    Raises LogError for a path that the system refuses, such as one that is too long.
    """
    try:
        return path / "policy.npz" if path.is_dir() else path
    except OSError as error:
        raise LogError(f"{path}: {error.strerror}") from error


def features(observation: Array) -> Array:
    """Features (..., n), the network's inputs, for observations (..., n)."""
    seen = np.array(observation, float)
    seen[..., ERRORS] = np.arcsinh(seen[..., ERRORS] / FINE)
    return seen


def corrected(observation: Array, correction: Array, authority: ArrayLike) -> Array:
    """Actions (N, 2): the reference's current twist in observations (N, n), plus corrections (N, 2)
    in [-1, 1].
    """
    added = np.clip(correction, -1.0, 1.0) * np.asarray(authority)
    return np.clip(observation[:, TWIST_NOW] + added, -1.0, 1.0)


def _product(x: Array, weight: Array) -> Array:
    """Product (N, m) of rows (N, n) and a weight (n, m).

    A matrix product would round differently for different N. Blocks of rows limit the memory.
    """
    rows = max(1, _CACHED_PRODUCTS // weight.size)
    blocks = []
    for first in range(0, max(len(x), 1), rows):
        block = x[first : first + rows]
        blocks.append(np.add.reduce(block[:, :, None] * weight, axis=1))
    return np.concatenate(blocks)


class PolicyController:
    """A controller that builds the environment's observations from poses and applies a policy to
    them.
    """

    def __init__(self, policy: TrackingPolicy, top_speed: float) -> None:
        """Use sprockets with this `top_speed` [rad/s]; raises InvalidValueError for a policy of
        another environment.
        """
        config = policy.environment()
        require(config.action == "twist", "action of the policy", config.action, "'twist'")
        allowed = "false: controllers sense no loads"
        require(not config.loads, "loads of the policy", config.loads, allowed)
        self._policy = policy
        self._layout = TrackingLayout(config, top_speed)
        shape = policy.network.shape
        inputs = len(self._layout.elements)
        require(shape == (inputs, 2), "network of the policy", shape, f"from {inputs} inputs to 2")
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
        count = len(error)
        previews = reference.twist(time + self._layout.steps * PERIOD)
        observation = self._layout.observation(
            error,
            np.broadcast_to(previews, (count, *previews.shape)),
            np.broadcast_to(self._omega, (count, 2)),
            np.broadcast_to(self._action, (count, 2)),
        )
        self._action = self._policy.action(observation)
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
    text, constants = _graph(policy, len(observed), len(commanded))
    graph = onnx.parser.parse_graph(text)
    for name, value in constants.items():
        graph.initializer.append(onnx.numpy_helper.from_array(np.asarray(value), name))
    opset = onnx.helper.make_opsetid("", _OPSET)
    model = onnx.helper.make_model_gen_version(
        graph, producer_name="trackslip", opset_imports=[opset]
    )
    about = {
        "observation": [asdict(each) for each in observed],
        "action": [asdict(each) for each in commanded],
        "options": policy.options,
    }
    metadata = {name: json.dumps(value) for name, value in about.items()}
    onnx.helper.set_model_props(model, metadata)
    onnx.checker.check_model(model)
    path.write_bytes(model.SerializeToString())


def _graph(policy: Policy, inputs: int, outputs: int) -> tuple[str, dict[str, Any]]:
    """The text of a policy's graph in ONNX's syntax, and the constants in it."""
    before = "hidden0 = Identity (observation)"
    after = "action = Clip (output, low, high)"
    constants: dict[str, Any] = {"low": np.float32(-1.0), "high": np.float32(1.0)}
    if isinstance(policy, TrackingPolicy):
        before = _FEATURES
        after = _CORRECTED
        twist = TWIST_NOW.stop - TWIST_NOW.start
        others = inputs - TWIST_NOW.stop
        constants["sizes"] = np.array([ERRORS.stop, twist, others])
        constants["fine"] = np.float32(FINE)
        constants["authority"] = np.array(policy.authority, np.float32)
    layers = []
    network = policy.network
    for k, (weight, bias) in enumerate(zip(network.weights, network.biases, strict=True)):
        constants[f"weight{k}"] = np.float32(weight)
        constants[f"bias{k}"] = np.float32(bias)
        layers.append(f"layer{k} = Gemm (hidden{k}, weight{k}, bias{k})")
        layers.append(f"hidden{k + 1} = Tanh (layer{k})")
    layers[-1] = f"output = Identity (layer{k})"  # the last layer is linear
    ends = f"policy (float[N, {inputs}] observation) => (float[N, {outputs}] action)"
    return f"{ends} {{ {before} {' '.join(layers)} {after} }}", constants
