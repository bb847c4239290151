"""Small networks in NumPy, and the files that store policies."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from trackslip.errors import LogError
from trackslip.files import regular_file
from trackslip.kinematics import Array

_PRODUCTS = 100_000  # of rows and weights at a time, which fit into a processor's cache


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
        raise LogError(f"{file}: not a policy, or damaged") from error


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
