"""The environments' names, told to gymnasium when it is imported: who doesn't learn needn't wait for it."""

from __future__ import annotations

import importlib.machinery
import sys
from collections.abc import Sequence
from types import ModuleType


def register_with_gymnasium() -> None:
    """Register the environments, at once if gymnasium has been imported, else when it will be."""
    if "gymnasium" in sys.modules:
        _register()
    elif _Finder not in sys.meta_path:
        sys.meta_path.insert(0, _Finder)


def _register() -> None:
    import gymnasium

    gymnasium.register(
        id="trackslip/PathTracking-v0",
        entry_point="sim.env:PathTrackingEnv",
        vector_entry_point="sim.vector_env:PathTrackingVectorEnv",
    )


class _Loader(importlib.machinery.SourceFileLoader):
    def exec_module(self, module: ModuleType) -> None:
        super().exec_module(module)
        _register()


class _Finder:
    """Finds gymnasium where Python would, and has the environments registered when it is loaded."""

    @classmethod
    def find_spec(
        cls, name: str, path: Sequence[str] | None = None, target: ModuleType | None = None
    ) -> importlib.machinery.ModuleSpec | None:
        if name != "gymnasium":
            return None
        spec = importlib.machinery.PathFinder.find_spec(name, path, target)
        if spec is not None and spec.origin is not None:
            spec.loader = _Loader(name, spec.origin)
        return spec
