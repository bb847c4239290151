"""What the numbers of a run depend on besides its options: code, models and libraries."""

from __future__ import annotations

import functools
import hashlib
import json
from pathlib import Path
from typing import Any

import experiments
import models
import sim
import trackslip
from experiments.storage import results as store

_CODE, _MODELS = (trackslip, sim, experiments), (models,)
_SUFFIXES = (".py", ".xml", ".json", ".obj")


@functools.cache
def made_by() -> dict[str, Any]:
    """Digests of the code and of the models, and versions of the libraries."""
    return {"code": _digest_of(_CODE), "models": _digest_of(_MODELS), "versions": store.versions()}


def digest(value: Any) -> str:
    """A short name for `value`, which JSON must know, by its content."""
    return hashlib.sha256(json.dumps(store.plain(value), sort_keys=True).encode()).hexdigest()[:32]


def content(path: Path) -> str | None:
    """A file's digest; None where there is no file."""
    return hashlib.sha256(path.read_bytes()).hexdigest() if path.is_file() else None


def changes(before: dict[str, Any], now: dict[str, Any]) -> list[str]:
    """What differs between two of `made_by`, in words."""
    found = [f"trackslip's {name}" for name in ("code", "models") if before.get(name) != now[name]]
    old = before.get("versions", {})
    return found + [f"{name} ({old.get(name)}, now {v})" for name, v in now["versions"].items() if old.get(name) != v]


def _digest_of(packages: Any) -> str:
    files = [
        (package.__name__, str(file.relative_to(root)), content(file))
        for package in packages
        for root in (Path(str(package.__path__[0])),)
        for file in sorted(root.rglob("*"))
        if file.suffix in _SUFFIXES
    ]
    return digest(files)
