"""The state of a MuJoCo batch, saved and restored."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from mujoco import batch


def engine_state(of: batch.Batch) -> dict[str, Any]:
    """The state of a batch, with the fields of its model that differ between simulations."""
    found = {name: of.expanded(name) for name in batch.MODEL_FIELDS}
    model = {name: values.copy() for name, values in found.items() if values is not None}
    return {"state": of.state.copy(), "warning": of.warning.copy(), "model": model}


def restore_engine(of: batch.Batch, state: Mapping[str, Any]) -> None:
    """Return to a state of a batch of the same model."""
    of.state[:], of.warning[:] = state["state"], state["warning"]
    for name in batch.MODEL_FIELDS:
        if name in state["model"]:
            of.expand(name)[...] = state["model"][name]
        elif of.expanded(name) is not None:
            of.expand(name)[...] = getattr(of.model.opt if name.startswith("opt.") else of.model, name.split(".")[-1])
