"""Trained policies as ONNX files, from the environment's observations to its actions; they need the extra `rl`."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from sim.policy import ERRORS, FINE, TWIST_NOW, Network, Policy
from sim.task import Element
from sim.traverse.policy import CrossingPolicy
from trackslip.errors import TrackslipError

_OPSET = 18


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
