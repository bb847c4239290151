"""The format version of stored results, so that files from a newer trackslip are refused instead of misread."""

from __future__ import annotations

import importlib.metadata
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from trackslip.errors import LogError
from trackslip.files import read_json

FORMAT = 1
"""Format of the manifests, laws and runs written by this version; it increases when older versions cannot read them."""
MANIFEST = "manifest.json"


def require_known_format(content: Mapping[str, Any], source: object) -> None:
    """Raise LogError if `content`, called `source` in the message, is from a newer version.

    Without `format`, it is of the first one. A manifest has `versions`, which name the version that wrote it.
    """
    version = content.get("format", 1)
    if version not in range(1, FORMAT + 1):
        versions = content.get("versions")
        writer = versions.get("trackslip") if isinstance(versions, Mapping) else None
        by = f"trackslip {writer}" if writer else "a newer trackslip"
        this = f"trackslip {installed_version()}"
        raise LogError(f"{source}: written by {by} in format {version}; {this} reads formats up to {FORMAT}")


def installed_version() -> str:
    """The version of trackslip, "(unknown version)" in a checkout that isn't installed."""
    try:
        return importlib.metadata.version("trackslip")
    except importlib.metadata.PackageNotFoundError:
        return "(unknown version)"


def known_manifest(folder: Path) -> Mapping[str, Any]:
    """The manifest of a folder of results, empty where there is none, as in a folder of a real robot's logs.

    Raises LogError if it is damaged or from a newer version.
    """
    file = folder / MANIFEST
    if not file.exists():
        return {}
    content = read_json(file)
    if not isinstance(content, Mapping):
        raise LogError(f"{file}: not a manifest")
    require_known_format(content, file)
    return content
